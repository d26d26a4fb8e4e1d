"""One damping for several records: probabilities and sizes by hand and by quadrature."""

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from bayesdamp.inference.deviation.linear import LEAST_KNOTS, grid_of
from bayesdamp.inference.deviation.specimen import Model, RatioLikelihood, RunComparison, compare_runs
from bayesdamp.inference.model.target import damping_priors
from bayesdamp.priors import FURTHER_TERM, OTHER_FORMS_COUNT, OTHER_FORMS_ODDS, SharedHalfNormal
from bayesdamp.types import Reference
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import Bound, DampingRatio, Grade, Interval, Share
from bayesdamp.verdict.specimen import RecordAnswer, common_verdict, pool_coefficients, pool_records, specimen
from bayesdamp.verdict.types import Verdict
from tests.inference.runs import by_quadrature, run_of
from tests.report.pages import numbers

AMPLITUDE = np.array([0.1, 0.2, 0.4])
REFERENCE = Reference(1.0, 1.0)
V, Q, C = ("viscous", "linear"), ("quadratic", "linear"), ("coulomb", "linear")


def ratio_likelihood(damping: str, ratio: float, sd: float, log: float | np.ndarray = 0.0) -> RatioLikelihood:
    """Return the likelihood of a damping ratio, the same at all amplitudes, that is known to ± sd; its peak is e^log.

    All terms have the same prior of their ratio, so that the evidence of their coefficients cancels between them."""
    ((name, prior),) = damping_priors([damping], REFERENCE).items()
    scale = prior.per_ratio
    likelihood = run_of([name], [ratio * scale], np.array([[(sd * scale) ** 2]]), log)
    per_unit = np.full((AMPLITUDE.size, 1), 1 / scale)
    return RatioLikelihood(**vars(likelihood), per_unit=per_unit, growth=np.zeros((AMPLITUDE.size, 1)))


def answered(
    name: str,
    ratio: float,
    logs: dict[Model, float | np.ndarray],
    grade: Grade = Grade.EXACT,
    sd: float = 0.001,
    others: Mapping[str, tuple[float, str]] = MappingProxyType({}),
) -> RecordAnswer:
    """Return the answer on a record whose damping ratio is known to ± sd.

    logs: the log evidences of models; others: those of other forms, and the sums to which they reduce."""
    shares = (Share("viscous", 0.6, 0.5, 0.7, 1.0), Share("quadratic", 0.4, 0.3, 0.5, 1.0))
    every = {**logs, **{(form, "linear"): log for form, (log, _) in others.items()}}
    comparison = RunComparison(
        {m: float(np.max(v)) for m, v in logs.items()},
        {form: limit for form, (_, limit) in others.items()},
        {m: ratio_likelihood(m[0], ratio, sd, v) for m, v in every.items()},
        REFERENCE,
        AMPLITUDE[::-1],
    )
    likeliest = max(comparison.log_evidence, key=lambda k: comparison.log_evidence[k])[0]
    verdict = Verdict(
        name, grade, True, likeliest, 0.9, energy=shares,
        damping_ratio=(DampingRatio(0.2, "deg", ratio, 0, 0, 0, 0),),
        frequency=Interval(2.0, 1.9, 2.1, "Hz"), deviation=Interval(0.02 * len(name), 0.0, 0.1),
    )  # fmt: skip
    return RecordAnswer(verdict, comparison, {"amplitude": AMPLITUDE})


def test_probabilities_are_those_of_all_records_together() -> None:
    """By hand: the log evidences of two dampings with the same ratio add up over two records."""
    records = [answered("a", 0.01, {V: 0.0, Q: -1.0}), answered("b", 0.01, {V: -0.5, Q: 0.0})]
    verdict = specimen("rig", records)
    assert verdict.damping == "viscous"
    assert verdict.probability == pytest.approx(1 / (1 + np.exp(-0.5)), rel=1e-4)
    (rival,) = verdict.rivals
    assert (rival.damping, rival.probability) == ("quadratic", pytest.approx(1 / (1 + np.exp(0.5)), rel=1e-4))
    assert not verdict.decided
    remark = "The most probable damping of the records, each by itself: viscous in 1, quadratic (drag) in 1."
    assert remark in verdict.remarks


def test_records_of_one_specimen_share_the_size_of_their_deviations() -> None:
    """By hand: each of four records prefers quadratic damping by 1 nat to viscous damping with deviations of one size.

    The low prior of this size counts once, not four times."""
    prior = grid_of(LEAST_KNOTS).log_prior
    size = int(np.argmin(prior))
    only_this_size = np.where(np.arange(prior.size) == size, -prior[size], -300.0)
    each = [answered(n, 0.01, {V: only_this_size, Q: np.ones(prior.size)}) for n in "abcd"]
    each = [replace(a, comparison=replace(a.comparison, log_evidence={V: 0.0, Q: 1.0})) for a in each]
    ahead = -3 * prior[size] - 4
    assert ahead > 10
    joint = compare_runs([a.comparison for a in each])
    assert joint.log_evidence[V] - joint.log_evidence[Q] == pytest.approx(ahead, abs=1e-3)
    assert specimen("rig", each).damping == "viscous"


def test_each_further_term_has_lower_prior_odds() -> None:
    three, two = ("viscous+coulomb+quadratic", "linear"), ("viscous+coulomb", "linear")
    joint = compare_runs([RunComparison({V: 0.0, two: 0.0, three: 0.0})])
    odds = np.array([1.0, FURTHER_TERM, FURTHER_TERM**2])
    assert joint.probability == pytest.approx(dict(zip((V, two, three), odds / odds.sum())))


def test_a_damping_that_a_record_was_not_compared_with_is_far_behind() -> None:
    verdict = specimen("rig", [answered("a", 0.01, {V: 0.0, Q: 2.0}), answered("b", 0.01, {V: 0.0})])
    assert (verdict.damping, verdict.probability, verdict.decided) == ("viscous", thresholds.CAP, True)


def test_log_evidence_of_another_form_adds_up_over_records() -> None:
    """By hand: in each of two records 3 nats more than viscous damping, with a ninetieth of its prior probability."""
    hard = "viscous", "duffing"
    form, other = {"displacement": (3.0, "")}, {"cubic": (-9.0, "coulomb")}
    second = answered("b", 0.01, {V: 0.0, hard: -40.0}, others=form)
    ahead = math.exp(6) * OTHER_FORMS_ODDS / OTHER_FORMS_COUNT
    for others in (form, form | other):
        first = answered("a", 0.01, {V: 0.0, hard: -40.0}, others=others)
        verdict = specimen("rig", [first, second])
        assert (verdict.damping, verdict.rivals[0].damping) == ("viscous", "displacement")
        assert verdict.probability == pytest.approx(1 / (1 + ahead), rel=1e-3)
        assert not verdict.decided
    assert specimen("rig", [first, answered("b", 0.01, {V: 0.0, hard: -40.0})]).probability == thresholds.CAP


def test_ratio_spread_and_prediction_are_those_of_quadrature() -> None:
    """Ends of intervals within 10 % of their width: the posterior is nearly log-normal, and the draws are normal.
    Control: the next record's interval is wider."""
    places, sd = [0.0100, 0.0112, 0.0106], 0.0002
    verdict = specimen("rig", [answered(n, r, {V: 0.0}, sd=sd) for n, r in zip("abc", places, strict=True)])
    x = np.geomspace(0.4 * min(places), 2.5 * max(places), 1201)
    log_prior = SharedHalfNormal(per_ratio=1.0).log_density(x) + np.log(np.gradient(x))
    truth = by_quadrature([run_of(["zeta"], [p], np.array([[sd**2]])) for p in places], x[:, None], log_prior)
    below = np.cumsum(truth.mass)
    low, middle, high = (float(np.interp(q, below, x)) for q in (0.025, 0.5, 0.975))
    for r in verdict.damping_ratio:
        assert (r.low, r.value, r.high) == pytest.approx((low, middle, high), abs=0.1 * (high - low))
        assert r.unit == "deg"
    assert verdict.damping_ratio[1].amplitude == pytest.approx(0.2)
    (zeta,) = verdict.coefficients
    assert (zeta.name, zeta.unit) == ("zeta", "1/s")
    assert (zeta.low, zeta.value, zeta.high) == pytest.approx((low, middle, high), abs=0.1 * (high - low))
    spread = np.cumsum(truth.each.sum(axis=0))
    for q, value in ((0.5, verdict.spread.value), (0.975, verdict.spread.high)):
        assert value == pytest.approx(float(np.interp(q, spread, truth.spreads)), rel=0.12)
    rng = np.random.default_rng(1)
    cells = rng.choice(truth.each.size, 100_000, p=truth.each.ravel())
    rows, columns = np.unravel_index(cells, truth.each.shape)
    more = x[rows] * np.exp(truth.spreads[columns] * rng.standard_normal(rows.size))
    ends = np.quantile(more, [0.025, 0.975])
    following = verdict.next_record[1]
    assert (following.low, following.high) == pytest.approx(tuple(ends), abs=0.1 * np.ptp(ends))
    assert following.high - following.low > 1.3 * (high - low)
    assert np.hypot(following.sd_noise, following.sd_law) == pytest.approx(np.ptp(ends) / 3.92, rel=0.25)
    assert verdict.row()["ratio_2_next_low"] == following.low
    differs, more = (numbers(text) for text in verdict.remarks[:2])
    for shown, of, percents in ((differs, verdict.spread, (0, 2, 3)), (more, following, (0, 1, 2))):
        stored = 100 * of.value, 100 * of.low, 100 * of.high
        assert all(shown[i].is_right(size) for i, size in zip(percents, stored)), verdict.remarks


def test_coefficients_of_specimens_are_pooled_if_all_have_the_same_damping() -> None:
    """Control: with another damping, another unit or a single specimen nothing is pooled."""
    each = [specimen(n, [answered(n, r, {V: 0.0}) for _ in range(2)]) for n, r in (("a", 0.01), ("b", 0.02))]
    ((first, pooled),) = pool_coefficients(each)
    own = [v.coefficients[0] for v in each]
    sds = [(c.high - c.low) / (2 * 1.959963984540054) for c in own]
    assert first == own[0]
    assert pooled == pool_records(np.array([c.value for c in own]), np.array(sds))
    in_m = replace(each[1], coefficients=(replace(own[1], unit="m/s²"),))
    other = specimen("c", [answered("c", 0.01, {Q: 0.0}) for _ in range(2)])
    for wrong in ([each[0], other], [each[0], in_m], each[:1], []):
        assert pool_coefficients(wrong) == []


def test_ratios_are_given_at_amplitudes_that_all_records_reach() -> None:
    first, second = (answered(n, 0.01, {V: 0.0}) for n in "ab")
    lower = replace(second, curve={"amplitude": 0.8 * AMPLITUDE})
    middle = specimen("rig", [first, lower]).damping_ratio[1].amplitude
    assert middle == pytest.approx(np.sqrt(0.8 * AMPLITUDE.max() * AMPLITUDE.min()))


def test_without_a_common_amplitude_each_ratio_is_that_of_the_records_that_reach_it() -> None:
    """Dry friction of one size, whose damping ratio is k/A, in records with amplitudes of 0.1 to 0.4 and of 1 to 4."""
    each = []
    for name, amplitude in (("a", AMPLITUDE), ("b", 10 * AMPLITUDE)):
        friction = answered(name, 0.01, {C: 0.0}, sd=1e-5)
        run = friction.comparison.runs[C]
        run = replace(run, per_unit=run.per_unit / amplitude[::-1, None])
        comparison = replace(friction.comparison, runs={C: run}, amplitudes=amplitude[::-1])
        each.append(RecordAnswer(friction.verdict, comparison, {"amplitude": amplitude}))
    verdict = specimen("rig", each)
    assert [r.amplitude for r in verdict.damping_ratio] == pytest.approx([2.0, 0.2])
    assert [r.value * r.amplitude for r in verdict.damping_ratio] == pytest.approx([0.01, 0.01], rel=2e-3)
    assert verdict.remarks[0].startswith("Not all of the 2 records reach these amplitudes.")
    (beyond,) = specimen("rig", each[:1], amplitudes=[0.5]).damping_ratio
    assert beyond.value == pytest.approx(0.02, rel=2e-3)


def test_a_damping_is_not_decided_while_no_record_excludes_its_twin() -> None:
    """Control: a single record that excludes the twin is enough."""
    structural = ("structural", "linear")
    for limits, decided in [((0.6, 0.4), False), ((0.6, 0.05), True)]:
        records = []
        for name, limit in zip("ab", limits, strict=True):
            record = answered(name, 0.01, {V: 0.0, structural: -8.0})
            bounds = (Bound("structural", limit),)
            records.append(replace(record, verdict=replace(record.verdict, other_forms=bounds)))
        verdict = specimen("rig", records)
        assert verdict.decided is decided
        remark = "No record can distinguish viscous damping from structural"
        assert any(remark in r and "Up to 40 % of the loss" in r for r in verdict.remarks) is not decided


def test_frequencies_of_records_are_pooled_and_a_specified_frequency_stays() -> None:
    """The interval is that of the mean. Control: that of one more record is wider."""

    def with_frequencies(*frequencies: Interval | None) -> Verdict:
        """A specimen whose records have these natural frequencies."""
        pairs = zip([answered(n, 0.01, {V: 0.0}) for n in "ab"], frequencies, strict=True)
        return specimen("rig", [replace(a, verdict=replace(a.verdict, frequency=f)) for a, f in pairs])

    sd, first = 0.1 / 1.959963984540054, Interval(2.0, 1.9, 2.1, "Hz")
    expected = pool_records(np.array([2.0, 2.3]), np.full(2, sd))
    frequency = with_frequencies(first, Interval(2.3, 2.2, 2.4, "Hz")).frequency
    half = 1.959963984540054 * expected.sd
    ends = (expected.mean, expected.mean - half, expected.mean + half)
    assert (frequency.value, frequency.low, frequency.high) == pytest.approx(ends, rel=1e-9)
    assert expected.low < frequency.low < frequency.high < expected.high
    assert frequency.unit == "Hz"
    other = with_frequencies(first, Interval(4.0, 3.9, 4.1, "Hz"))
    assert other.frequency is None
    assert other.remarks[0].startswith("The natural frequencies of the records differ, from 2 to 4 Hz")
    given = Interval(2.0, 2.0, 2.0, "Hz")
    assert with_frequencies(given, given).frequency == given
    assert with_frequencies(None, None).frequency is None


def test_a_specimen_has_the_worst_grade_and_the_largest_deviation_of_its_records() -> None:
    records = [answered("a", 0.01, {V: 0.0}), answered("bb", 0.01, {V: 0.0}, grade=Grade.DEVIATES)]
    verdict = specimen("rig", records)
    assert (verdict.grade, verdict.decided) == (Grade.DEVIATES, False)
    assert verdict.deviation == Interval(0.04, 0.0, 0.1)
    undetected = [replace(records[0].verdict, deviation=Interval(0.0, 0.0, high)) for high in (0.1, 0.2)]
    assert common_verdict("rig", undetected, {"viscous": 1.0}, {}).deviation == undetected[1].deviation
    for law, decided in (("duffing", False), ("linear", True)):  # the spring of a record may be doubtful
        bent = replace(undetected[0], restoring=law, restoring_deviation=Interval(0.01, 0.0021, 0.02))
        assert common_verdict("rig", [undetected[1], bent], {"viscous": 1.0}, {}).decided is decided
    shares = [("viscous", 0.6, 0.5, 0.7), ("quadratic", 0.4, 0.3, 0.5)]
    assert [(s.term, s.share, s.low, s.high) for s in verdict.energy] == shares


def test_a_deviation_that_all_records_share_changes_the_damping_ratio_of_the_specimen() -> None:
    """By hand: records that lose e^0.2 times the energy of their law have e^0.2 times its ratio. Control: e^0."""

    def value(over: float, sd: float = 0.01) -> float:
        deviation = {"over": np.full(AMPLITUDE.size, over), "over_sd": np.full(AMPLITUDE.size, sd)}
        each = [answered(name, 0.01, {V: 0.0}, sd=1e-5) for name in ("a", "b", "c")]
        each = [replace(r, curve={**r.curve, **deviation}) for r in each]
        return specimen("rig", each).damping_ratio[1].value

    assert value(0.2) / value(0.0) == pytest.approx(np.exp(0.2), rel=0.01)
    assert value(0.0, 0.0) == pytest.approx(value(0.0), rel=0.01)  # the law holds exactly in all records


def test_records_without_a_common_model_have_no_common_verdict() -> None:
    """The models of the second specimen's records were fitted to all of them, but one record all but excludes each."""
    viscous, quadratic = answered("a", 0.01, {V: 0.0}), answered("b", 0.01, {Q: 0.0})
    both = answered("c", 0.01, {V: 0.0, C: -200.0}), answered("d", 0.01, {Q: 0.0, C: -200.0})
    for records in ((viscous, quadratic), both):
        verdict = specimen("rig", records)
        assert (verdict.grade, verdict.damping, verdict.decided) == (Grade.NOT_WEIGHED, "", False)
        names = [r.verdict.record for r in records]
        assert f"viscous in {names[0]}; quadratic (drag) in {names[1]}." in verdict.sentence
    assert pool_coefficients([verdict, verdict]) == []
