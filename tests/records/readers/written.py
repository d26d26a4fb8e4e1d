"""Two decays, and functions that write them into files of every format, by its own library or by hand."""

import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.io import wavfile

from tests.records.tables import T, Y

RATE = 50.0
Z = 0.2 * np.exp(-0.15 * T) * np.cos(7 * T + 1)


def uff(path: Path, even: int = 1, names: tuple[str, ...] = ("arm", "beam")) -> None:
    import pyuff

    file = pyuff.UFF(str(path))
    for name, y in zip(names, (Y, Z), strict=False):
        data = pyuff.prepare_58(
            binary=0, func_type=1, rsp_ent_name=name, rsp_node=0, rsp_dir=0, ref_node=0, ref_dir=0, data=y, x=T,
            id1="a record", abscissa_spacing=even, abscissa_min=0.0, abscissa_inc=1 / RATE, abscissa_spec_data_type=17,
            ordinate_spec_data_type=12, orddenom_spec_data_type=0, ordinate_axis_units_lab="m/s^2",
        )  # fmt: skip
        file.write_sets(data, mode="add" if path.exists() else "overwrite")


def binary_uff(path: Path) -> None:
    """Write a data set 58b by hand, as in the standard, because pyuff repeats the first line."""
    uff(path.with_suffix(".ascii"))
    sets = path.with_suffix(".ascii").read_text(encoding="utf-8")
    sets = re.split(r"    -1\n    58 *\n", sets)[1:]
    parts = []
    for text, y in zip(sets, (Y, Z), strict=True):
        head = "".join(text.splitlines(keepends=True)[:11])
        mark = f"    -1\n{58:6d}b{1:6d}{2:6d}{11:12d}{8 * y.size:12d}{0:6d}{0:6d}{0:12d}{0:12d}\n"
        parts.append((mark + head).encode() + y.astype("<f8").tobytes() + b"\n    -1\n")
    path.write_bytes(b"".join(parts))


def tdms(path: Path) -> None:
    from nptdms import ChannelObject, RootObject, TdmsWriter

    properties = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0, "unit_string": "deg"}
    with TdmsWriter(path) as writer:
        channels = [ChannelObject("Bench", name, y, properties) for name, y in (("roll", Y), ("pitch", Z))]
        writer.write_segment([RootObject({"operator": "somebody"}), *channels])


def lvm(path: Path) -> None:
    head = [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab", "Decimal_Separator\t,", "X_Columns\tNo",
        "Date\t2024/05/03", "***End_of_Header***\t", "\t", "Channels\t2\t\t", "Samples\t600\t600\t",
        "Y_Unit_Label\tmm\tmm\t", "X0\t0,0\t0,0\t", "Delta_X\t0,02\t0,02\t", "***End_of_Header***\t\t\t",
        "X_Value\tfront\tback\tComment",
    ]  # fmt: skip
    rows = [f"\t{y!r}\t{z!r}".replace(".", ",") for y, z in zip(Y.tolist(), Z.tolist())]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")


def cassy(path: Path, unit: str = "s", packed: bool = False) -> None:
    """Write a file of CASSY Lab 2: a list of runs for each quantity; times are in s, whatever unit is shown."""
    index = np.arange(1, 601)
    quantities = [
        ("Index", "n", "", (index, index)), ("Zeit", "t", unit, (T, T)),
        ("Winkel", "\N{GREEK SMALL LETTER ALPHA}_A1", "\N{DEGREE SIGN}", (Y, Z)),
    ]  # fmt: skip
    lists = []
    for name, symbol, unit, runs in quantities:
        lists.append(f'<channels count="{len(runs)}" runs="true" runindex="0">')
        for values in runs:
            cells = "".join(f"<value>{x!r}</value>" for x in values.tolist())
            head = f"<quantity>{name}</quantity><symbol>{symbol}</symbol><unit>{unit}</unit>"
            lists.append(f'<channel dec="2">{head}<values count="600">{cells}</values></channel>')
        lists.append("</channels>")
    text = '<?xml version="1.0" encoding="utf-8"?><cassylab xml:lang="de-DE"><allchannels count="3">'
    text += "".join(lists) + "</allchannels></cassylab>"
    if packed:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("data.xml", text)
    else:
        path.write_text(text, encoding="utf-8")


def excel(path: Path) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    book.active.title = "First"
    for sheet, y in ((book.active, Y), (book.create_sheet("Second"), Z)):
        for row in (["Time (s)", "Angle (deg)"], *zip(T.tolist(), y.tolist())):
            sheet.append(row)
    book.create_sheet("Remarks").append(["nothing here"])
    evaluation = book.create_sheet("Evaluation")  # without times
    for row in (["n", "A (deg)"], *([i, 0.9**i] for i in range(12))):
        evaluation.append(row)
    book.save(path)


def parquet(path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    stamps = np.datetime64("2024-05-03T10:00:00", "us") + np.round(T * 1e6).astype("m8[us]")
    x = pyarrow.field("x", pyarrow.float64(), metadata={"unit": "mm"})
    schema = pyarrow.schema([pyarrow.field("stamp", pyarrow.timestamp("us")), x])
    pyarrow.parquet.write_table(pyarrow.table([stamps, Y], schema=schema), path)


def hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        data = file.create_dataset("bench/accelerometer", data=Y)
        data.attrs["units"] = "g"
        data.attrs["sample_rate"] = RATE


def matlab_73(path: Path) -> None:
    """Write the layout of MATLAB: cells are references, text is an array of character codes."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"] = T[None, :]
        file["#refs#/a"], file["#refs#/b"] = Y[None, :], Z[None, :]
        runs = file.create_dataset("angles", (2, 1), dtype=h5py.ref_dtype)
        runs[:, 0] = [file["#refs#/a"].ref, file["#refs#/b"].ref]
        runs.attrs["MATLAB_class"] = np.bytes_("cell")
        note = file.create_dataset("who", data=np.array([[97], [98]], np.uint16))
        note.attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


def wav(path: Path) -> None:
    wavfile.write(path, int(RATE), np.round(1e4 * np.stack([Y, Z], axis=1)).astype(np.int16))


def write_json(path: Path) -> None:
    path.write_text(json.dumps({"sample_rate": RATE, "unit": "deg", "roll": Y.tolist()}), encoding="utf-8")


FORMATS: dict[str, tuple[str, Callable[[Path], object], list[str], str, str, float | None]] = {
    # file, writer, channels, unit, quantity, rate where the file has no column of times
    "UFF ascii": ("a.uff", uff, ["arm", "beam"], "m", "acceleration", RATE),
    "UFF binary": ("b.unv", binary_uff, ["arm", "beam"], "m", "acceleration", RATE),
    "UFF uneven": ("c.uff", lambda p: uff(p, even=0), ["arm", "beam"], "m", "acceleration", None),
    "UFF named as text": ("d.txt", uff, ["arm", "beam"], "m", "acceleration", RATE),
    "TDMS": ("a.tdms", tdms, ["roll", "pitch"], "deg", "angle", RATE),
    "LVM": ("a.lvm", lvm, ["front", "back"], "mm", "angle", RATE),
    "Excel": ("a.xlsx", excel, ["First.Angle (deg)", "Second.Angle (deg)"], "deg", "angle", None),
    "Parquet": ("a.parquet", parquet, ["x"], "mm", "angle", None),
    "HDF5": ("a.h5", hdf5, ["bench.accelerometer"], "g", "acceleration", RATE),
    "WAV": ("a.wav", wav, ["channel 1", "channel 2"], "counts", "angle", RATE),
    "JSON": ("a.json", write_json, ["roll"], "deg", "angle", RATE),
}
