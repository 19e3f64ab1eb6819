"""The exam's scorer against a folder small enough to count by hand, and the files between its commands."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.gap_exam import __main__ as command
from benchmarks.gap_exam import _answer, _score
from benchmarks.gap_exam._compare import compared
from benchmarks.gap_exam._files import Seal, read_arrays, read_seal, run_keys, write_seal
from benchmarks.gap_exam._score import marked_cases, read_answer
from benchmarks.gap_exam._table import ROWS, share_text, table
from benchmarks.gap_exam._whitening import resampled
from drivers.base.errors import ConfigurationError

N = 2000
NOMINAL = "[noise]\narw_deg_per_sqrt_h = 0.01\nbias_instability_dph = 0.0\n"
RAMP = np.linspace(-1.0, 1.0, N)
WAVE = np.sin(np.arange(N) / 30.0)


def cause(name, probability, parameters=None, sigma=None):
    return {"name": name, "probability": probability, "parameters": parameters or {}, "sigma": sigma or {}}


def facts(causes=(), stochastic=(), unknown=0.0, held_out=None, parts=()):
    share = held_out and {"share": held_out[0], "interval_95": list(held_out[1:])}
    return {
        "causes": list(causes),
        "stochastic": dict.fromkeys(stochastic, 0.9),
        "unknown_probability": unknown,
        "unknown_parts": [{"follows": follows} for follows in parts],
        "held_out": share,
        "verdict": "x",
    }


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(_score, "indistinct", lambda *_: False)  # these cases have no recordings
    for name in ("cases", "sealed", "answers"):
        (tmp_path / name).mkdir()
    (tmp_path / "nominal.toml").write_text(NOMINAL)

    def add(name, seal, found, closed=0.0, elsewhere=None, *, error="", seconds=2.0):
        parts = {f"{effect}|A|2": 5.0 * WAVE for effect, _ in seal.effects}
        parts |= {f"{effect}|B|0": 5.0 * WAVE for effect, _ in seal.effects}
        write_seal(tmp_path / "sealed", name, seal, parts)
        answer = {"facts": found, "error": error, "seconds": seconds}
        (tmp_path / "answers" / f"{name}.json").write_text(json.dumps(answer))
        arrays = {}
        for key in ("A|2", "B|0"):
            share = closed if key == "A|2" or elsewhere is None else elsewhere
            arrays[f"closed|{key}"] = 5.0 * WAVE * share + 7.0 + 3.0 * RAMP
            arrays[f"nominal|{key}"] = np.stack((RAMP, np.ones(N)))
            arrays[f"seen|{key}"], arrays[f"period|{key}"] = np.ones(N), np.ones(1)
        np.savez(tmp_path / "answers" / f"{name}.npz", **arrays)

    return SimpleNamespace(path=tmp_path, add=add)


def seal(kind, snr, names=None, **more):
    """A case whose effects have the given ratios and catalogue names."""
    names = {name: tuple((names or {}).get(name, (name,))) for name in snr}
    return Seal(kind, tuple((name, 1.0) for name in snr), snr, ("a 3", "b 1"), names, **more)


def rows(folder):
    lines = table([("f", list(marked_cases(folder.path)))])
    return {
        line.split(" | ")[0].removeprefix("| "): line.split(" | ")[2].removesuffix(" |") for line in lines[2:]
    }


def of(text):
    return text.split(" = ")[0]


def test_two_states_of_the_code_are_compared_case_by_case(folder, tmp_path_factory):
    one = seal("single", {"shupe": 4.0})
    folder.add("lost", one, facts([cause("shupe", 0.9)]))
    folder.add("null", seal("null", {}), facts())
    folder.add("same", one, facts([cause("warm_up", 0.9)]))
    folder.add("weak", seal("single", {"shupe": 0.5}), facts([cause("shupe", 0.9)]))
    folder.add("won", one, facts([cause("shupe", 0.9)], unknown=0.9))
    two, both = seal("pair", {"shupe": 4.0, "warm_up": 2.0}), [cause("shupe", 0.9), cause("warm_up", 0.9)]
    folder.add("pair", two, facts(both))
    before = tmp_path_factory.mktemp("states") / "before"
    shutil.copytree(folder.path, before)
    folder.add("lost", one, facts())
    folder.add("null", seal("null", {}), facts([cause("shupe", 0.9)]))
    folder.add("weak", seal("single", {"shupe": 0.5}), facts())
    folder.add("won", one, facts([cause("shupe", 0.9)]))
    folder.add("pair", two, facts(both, unknown=0.9))
    lost, null, pair, won, counts = compared(before, folder.path)
    assert lost.startswith("right -> not found: lost: shupe 4.0 -> no gap")
    assert null.startswith(
        "right -> an alarm without a gap, a false cause: null: nothing -> shupe 0.90 (false)"
    )
    assert won.startswith("unknown beside it -> right: won: ")
    assert pair.startswith("right -> unknown beside it: pair: ")
    assert counts == "2 of 6 cases with a fault before, 4 after"
    for path in (before / "answers").iterdir():
        path.unlink()
    with pytest.raises(ConfigurationError, match="no answered case in common"):
        list(compared(before, folder.path))


def test_singles_pairs_and_probabilities_count_as_by_hand(folder):
    # right and nothing else; a second name of the same mechanism; a false one beside; not seen
    folder.add(
        "single_1",
        seal("single", {"lag": 2.0}, {"lag": ("thermal_lag", "relaxation")}),
        facts([cause("relaxation", 0.95)]),
    )
    folder.add(
        "single_2", seal("single", {"shupe": 4.0}), facts([cause("shupe", 0.95), cause("gradient", 0.9)])
    )
    folder.add("single_3", seal("single", {"shupe": 12.0}), facts(unknown=0.9))
    lean = seal("single", {"lean": 5.0}, {"lean": ("axis_misalignment",)}, beside={"lean": ("table_tilt",)})
    folder.add("single_4", lean, facts([cause("axis_misalignment", 0.7), cause("table_tilt", 0.6)]))
    folder.add("single_5", seal("single", {"hum": 5.0}, {"hum": ("vibration_or_mains_line",)}),
               facts(stochastic=["vibration_or_mains_line", "noise_level"]))  # fmt: skip
    # one of two, and one that is not there; both
    folder.add(
        "pair_1",
        seal("pair", {"shupe": 5.0, "gradient": 2.0}),
        facts([cause("shupe", 0.95), cause("mode_hop", 0.95)]),
    )
    folder.add(
        "pair_2",
        seal("pair", {"shupe": 5.0, "gradient": 2.0}),
        facts([cause("shupe", 0.99), cause("gradient", 0.96)]),
    )
    found = rows(folder)
    assert of(found["singles: right and nothing else, SNR 1 to 3"]) == "1/1"
    assert of(found["singles: right and nothing else, SNR 3 to 10"]) == "2/3"
    assert of(found["singles: right and nothing else, SNR 10 up"]) == "0/1"
    assert of(found["singles: right one named, SNR 1 up"]) == "4/5"
    assert of(found["a false cause anywhere, SNR 3 up"]) == "2/6"
    assert of(found["pairs: precision"]) == "3/4"
    assert of(found["pairs: recall"]) == "3/4"
    assert of(found["pairs: exactly both"]) == "1/2"
    assert of(found["stated 94 to 100 %: true"]) == "5/6"
    assert of(found["stated 50 to 80 %: true"]) == "2/2"


def test_a_set_is_right_if_the_runs_cannot_tell_its_members_apart(folder, monkeypatch):
    asked = []

    def indistinct(_, name, true, stated, noise):
        asked.append((name, list(true), sorted(stated)))
        return name == "single_1"

    monkeypatch.setattr(_score, "indistinct", indistinct)
    pair = {**cause("gradient", 0.5), "set": ["gradient", "shupe"], "set_probability": 0.95}
    folder.add("single_1", seal("single", {"shupe": 5.0}), facts([pair]))
    folder.add("single_2", seal("single", {"shupe": 5.0}), facts([pair]))
    found = rows(folder)
    assert of(found["singles: right and nothing else, SNR 3 up"]) == "1/2"
    assert of(found["stated 94 to 100 %: true"]) == "1/2"
    assert ("single_1", ["shupe"], ["gradient"]) in asked


def test_nulls_outside_mixed_and_noise_count_as_by_hand(folder):
    folder.add("null_1", seal("null", {}), facts())
    folder.add("null_2", seal("null", {}), facts(stochastic=["bias_instability"]))
    folder.add("null_3", seal("null", {}), {}, error="ConfigurationError: refused")
    foreign = {"fan": ()}
    folder.add("outside_1", seal("outside", {"fan": 4.0}, foreign), facts(unknown=0.9), elsewhere=0.8)
    folder.add(
        "outside_2",
        seal("outside", {"fan": 4.0}, foreign),
        facts([cause("shupe", 0.9)], unknown=0.6),
        elsewhere=-0.5,
    )
    folder.add("outside_3", seal("outside", {"fan": 2.0}, foreign), facts())
    folder.add(
        "outside_4",
        seal("outside", {"age": 9.0}, {"age": ()}, changing=("age",)),
        facts(unknown=0.9, parts=["the repeat"]),
    )
    folder.add(
        "mixed_1",
        seal("mixed", {"shupe": 5.0, "fan": 5.0}, foreign),
        facts([cause("shupe", 0.9)], unknown=0.9),
    )
    folder.add("mixed_2", seal("mixed", {"shupe": 5.0, "fan": 5.0}, foreign), facts([cause("shupe", 0.9)]))
    folder.add(
        "noise_1", seal("noise", {"arw": 2.0}, {"arw": ("noise_level",)}), facts(stochastic=["noise_level"])
    )
    found = rows(folder)
    assert of(found["cases answered"]) == "9/10"
    assert of(found["nulls with anything named"]) == "1/2"
    assert of(found["outside, the same in repeats, SNR 3 up: called unknown"]) == "2/2"
    assert of(found["outside, the same in repeats, SNR 3 up: a false cause beside"]) == "1/2"
    assert of(found["outside, differing between repeats, SNR 3 up: said so"]) == "1/1"
    assert of(found["mixed: both reported"]) == "1/2"
    assert of(found["noise: right one named"]) == "1/1"
    assert of(found["seconds of processor a case, median / longest"]) == "2.0 / 2.0"


def test_the_true_shrinkage_leaves_out_what_the_nominal_model_re_calibrates(folder):
    """A closing of 0.9 of the amplitude, a constant and a ramp beside, leaves a hundredth of the energy."""
    one = seal(
        "single", {"shupe": 5.0}, left_out=("B|0",), parameters={"shupe": {"a": 1.0, "b": 5.0, "c": 0.0}}
    )
    stated = cause("shupe", 0.95, {"a": 1.15, "b": 4.0}, {"a": 0.1, "b": 0.4})
    folder.add("single_1", one, facts([stated], held_out=(0.85, 0.8, 0.9)), closed=0.9, elsewhere=0.5)
    folder.add("single_2", one, facts([stated], held_out=(0.98, 0.995, 1.0)), closed=0.9)
    folder.add("single_3", one, facts([stated], held_out=(None, None, None)), closed=1.0)
    cases = list(marked_cases(folder.path))
    # a hundredth of the energy in one run, a quarter in the other
    assert cases[0].closed == pytest.approx(1.0 - 0.26 / 2.0, abs=1e-4)
    assert cases[1].closed == pytest.approx(0.99, abs=1e-4)
    assert cases[0].elsewhere == pytest.approx(0.75, abs=1e-4)
    assert cases[0].covered == (True, False)
    found = rows(folder)
    assert of(found["interval of shrinkage holds the true one"]) == "1/2"
    assert found["named gap closed on held-out runs, median / 10th percentile"] == "0.99 / 0.89 (n = 3)"
    assert of(found["parameters: 95 % interval holds"]) == "3/6"


def test_a_learned_term_is_judged_on_the_profile_left_out(folder):
    for name, share in (("outside_1", 0.8), ("outside_2", -0.5), ("outside_3", 1.0)):
        folder.add(
            name,
            seal("outside", {"fan": 4.0}, {"fan": ()}, left_out=("B|0",)),
            facts(unknown=0.9),
            elsewhere=share,
        )
    found = rows(folder)
    # 1 - (1 - 0.8)^2, 1 - 1.5^2, 1
    assert found[
        "outside, the same in repeats: closed on a profile left out, median / 10th percentile"
    ].startswith("0.96 / -0.8")
    assert of(found["outside, the same in repeats: a profile left out worse than nominal"]) == "1/3"


def test_a_sealed_gap_of_2_s_meets_a_closing_of_1_s(folder):
    folder.add("single_1", seal("single", {"shupe": 5.0}), facts([cause("shupe", 0.9)]), closed=1.0)
    parts = read_arrays(folder.path / "sealed" / "single_1.npz")
    np.savez(
        folder.path / "sealed" / "single_1.npz",
        **{key: values.reshape(-1, 2).mean(axis=1) for key, values in parts.items()},
    )
    assert next(marked_cases(folder.path)).closed == pytest.approx(1.0, abs=1e-6)


def test_a_folder_of_the_second_plants_kind_is_read(folder):
    """Seals without names; answers as the command prints them; a hop of modes is known to the catalogue."""
    parts = {"modehop|CS|2": WAVE}
    write_seal(folder.path / "sealed", "outside_7_9", Seal("outside", (), {}, ()), parts)
    text = json.dumps(
        {"kind": "outside", "effects": [["modehop", 50.0]], "snr": {"modehop": 5.0}, "held_out": ["x"]}
    )
    (folder.path / "sealed" / "outside_7_9.json").write_text(text)
    printed = {"units": [facts([cause("mode_hop", 0.95)])]}
    (folder.path / "answers" / "outside_7_9.json").write_text(json.dumps(printed))
    found = rows(folder)
    assert of(found["singles: right and nothing else, SNR 3 up"]) == "1/1"


def test_wilson_intervals_are_the_textbooks():
    # Newcombe, Statistics in Medicine 17 (1998), table I: 81 of 263
    assert share_text([True] * 81 + [False] * 182) == "81/263 = 31 % [26, 37]"
    assert share_text([]) == "-"


def test_seals_and_run_keys_survive_their_files(tmp_path):
    kept = Seal("pair", (("a", 1.5), ("b", -2.0)), {"a": 3.0, "b": 4.0}, ("r 3",), {"a": ("x", "y"), "b": ()},
                {"a": ("z",), "b": ()}, {"a": {"v": 1.0}}, ("b",), ("OC|0",))  # fmt: skip
    write_seal(tmp_path, "n", kept, {"a|X|0": np.arange(3.0)})
    assert read_seal(tmp_path / "n.json") == kept
    assert read_arrays(tmp_path / "n.npz")["a|X|0"].tolist() == [0.0, 1.0, 2.0]
    (tmp_path / "runs.toml").write_text('[[run]]\nfile = "CY_A_3.csv"\nrun_id = "q"\n')
    assert run_keys(tmp_path) == {"q": "CY_A|2"}


def test_a_refusal_is_an_answer_and_a_case_is_answered_once(tmp_path, monkeypatch):
    case = tmp_path / "cases" / "null_1"
    case.mkdir(parents=True)
    (case / "runs.toml").write_text("format = 1\n")
    (case / "held_out.txt").write_text("a 3\n")
    (tmp_path / "nominal.toml").write_text(NOMINAL)

    def refuse(*_):
        raise ConfigurationError("too short")

    monkeypatch.setattr(_answer, "read_recordings", refuse)
    assert [name for name, _, _ in _answer.answer_all(tmp_path, 1)] == ["null_1"]
    assert "too short" in read_answer(tmp_path / "answers" / "null_1.json").error
    assert list(_answer.answer_all(tmp_path, 1)) == []


def test_the_table_goes_into_its_section_of_the_page(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A\n\ntext\n\n## B\n\nmore\n")
    command.put_section(page, "## Plant families", ["one"])
    command.put_section(page, "## Plant families", ["two"])
    assert page.read_text() == "# A\n\ntext\n\n## B\n\nmore\n\n## Plant families\n\ntwo\n"
    page.write_text("# A\n\n## Plant families\n\nold\n\n## B\n\nmore\n")
    command.put_section(page, "## Plant families", ["new"])
    assert page.read_text() == "# A\n\n## Plant families\n\nnew\n\n## B\n\nmore\n"
    assert len({what for what, _, _ in ROWS}) == len(ROWS)


@pytest.mark.parametrize(("period_s", "to_s"), [(1.0, 1.6), (0.8, 2.4), (1.6, 1.0), (2.0, 2.0)])
def test_means_over_other_steps_are_those_of_the_integral(period_s, to_s):
    # a line, given as its means over steps, has over any whole steps the mean of its middle
    def line(n, step_s):
        return 3.0 + 0.5 * (np.arange(n) + 0.5) * step_s

    means = resampled(np.stack((line(60, period_s), np.ones(60))), period_s, to_s)
    assert means.shape[1] == int(60 * period_s / to_s + 1e-6)
    assert means[0] == pytest.approx(line(means.shape[1], to_s), abs=0.5 * 0.26 * period_s)
    assert means[0].mean() == pytest.approx(line(means.shape[1], to_s).mean(), rel=2e-3)
    assert means[1] == pytest.approx(np.ones(means.shape[1]))


def test_closing_in_steps_of_another_length_than_the_seal_counts_whole(folder):
    folder.add("a", seal("single", {"x": 5.0}), facts([cause("x", 0.9)]), 1.0)
    path = folder.path / "answers" / "a.npz"
    arrays = dict(np.load(path))
    for key in ("A|2", "B|0"):
        for what in ("closed", "nominal", "seen"):
            rows = np.atleast_2d(arrays[f"{what}|{key}"])
            arrays[f"{what}|{key}"] = np.squeeze(resampled(rows, 1.0, 1.6))
        arrays[f"nominal|{key}"] = np.atleast_2d(arrays[f"nominal|{key}"])
        arrays[f"period|{key}"] = np.array([1.6])
    np.savez(path, **arrays)
    (marked,) = marked_cases(folder.path)
    assert marked.closed > 0.98
