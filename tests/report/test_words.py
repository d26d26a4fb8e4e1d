"""Numbers and names as the report writes them."""

import math

from bayesdamp import formatting as fmt


def test_a_value_has_the_digits_of_its_error():
    texts = {
        (0.129243, 0.000512): "0.12924 ± 0.00051",
        (0.1349, 0.0998): "0.135 ± 0.100",
        (-243.1, 12.0): "−243 ± 12",
        (3e-9, 0.12): "0.00 ± 0.12",
        (2.1e-7, 3e-9): "2.1 × 10⁻⁷ ± 3 × 10⁻⁹",
        (21234567.0, 3000.0): "2.12346 × 10⁷ ± 3000",
        (0.05, 1e-9): "0.05000000",
        (0.05, math.nan): "0.05000",
        (0.05, 0.0): "0.05000",
        (math.nan, 0.1): "–",
    }
    assert {at: fmt.with_error(*at) for at in texts} == texts


def test_single_values():
    """Numbers have four digits, percentages no exponent; probabilities are never rounded to certainty."""
    of_numbers = {
        12.3456: "12.35",
        9.9996: "10.00",
        1e-7: "1.000 × 10⁻⁷",
        -math.inf: "−∞",
        None: "–",
        0.0: "0",
    }
    for write, texts in (
        (fmt.number, of_numbers | {123456.0: "123456", 1234567.0: "1.235 × 10⁶"}),
        (fmt.percentage, {0.9987: "100", 0.0994: "9.9", 0.26: "26", 0.00123: "0.12"}),
        (fmt.probability, {1.0: "> 0.999", 0.0: "< 0.001", 0.9994: "0.999", math.nan: "–"}),
        (fmt.duration, {0.0: "0 ms", 3.04: "3.0 s", 59.9: "60 s", 125: "2 min 05 s", 7265: "2 h 01 min"}),
    ):
        assert {value: write(value) for value in texts} == texts


def test_times_and_rounded_digits_have_no_needless_exponent():
    assert [fmt.digits(x, n=2) for x in (12744.5, 0.0000123, 2e10)] == ["13000", "1.2 × 10⁻⁵", "2 × 10¹⁰"]
    assert fmt.time_span(36000.0, 36014.99) == "36000 to 36014.99 s"
    assert fmt.time_span(0.001155, 14.25) == "0 to 14.25 s"


def test_intervals_have_the_digits_of_their_width():
    assert fmt.interval(0.128204, 0.130211) == "[0.12820, 0.13021]"
    assert fmt.interval(-243.3, -200.1) == "[−243, −200]"
    assert fmt.interval(math.nan, 1.0) == "–"
    assert fmt.with_interval(0.0123, math.nan, 0.02, " %", 100) == "1.23 %, interval unbounded"


def test_a_list_has_commas_and_a_word_before_its_last_item():
    texts = {(): "", ("a",): "a", ("a", "b"): "a or b", ("a", "b", "c"): "a, b or c"}
    assert {items: fmt.listing(items, "or") for items in texts} == texts
