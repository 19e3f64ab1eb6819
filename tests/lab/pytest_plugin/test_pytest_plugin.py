"""The pytest plug-in as a product team uses it: in a pytest of its own, with a JUnit file."""

import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

pytest_plugins = ["pytester"]


@pytest.fixture
def inner(pytester, monkeypatch):
    """Run tests in a pytest within the test; returns outcomes and the JUnit properties of every test."""

    def run(source, *options):
        pytester.makepyfile(source)
        junit = pytester.path / "junit.xml"
        result = pytester.runpytest_subprocess("-p", "no:cacheprovider", f"--junitxml={junit}", *options)
        properties = {
            case.get("name"): {entry.get("name"): entry.get("value") for entry in case.iter("property")}
            for case in ElementTree.parse(junit).iter("testcase")
        }
        return result, properties

    return run


def test_runs_measurements_and_a_failing_one_end_up_in_the_junit_file(inner):
    result, properties = inner(
        """
        import math
        import pytest
        from bench.lab.emulated import Plant


        @pytest.fixture
        def bench_plant():
            return Plant(seed=4)


        def turn(bench):
            "A turn at 10 deg/s."
            bench.ask("Mounted?", act="mount", mounting="axis_up")
            bench.table.device.servo_on()
            bench.table.spin(10.0)
            start = bench.now_s
            bench.wait(60.0, "turning")
            rate = bench.gyros["fog_1"].mean_rate_dps(start)
            bench.measure("rate", rate, "deg/s", low=9.9, high=10.1)
            bench.measure("impossible", rate, "deg/s", low=20.0)


        def test_drive(bench):
            assert bench.emulated
            run = bench.drive(turn, judge=False)
            assert run.outcome == "completed" and run.value("rate") == pytest.approx(10.0, abs=0.05)
            assert run.record.manifest.emulated.seed == 4
            error_ppm = 1e6 * (run.value("rate") / 10.0 - 1.0)
            assert bench.measure("scale_error", error_ppm, "ppm", low=-5e4, high=5e4) == error_ppm


        def test_a_measurement_outside_fails(emulated_bench):
            emulated_bench.drive(turn)


        def test_a_computed_value_outside_fails(bench):
            bench.measure("drift", 0.3, "deg/h", high=0.1)


        def test_nan_never_passes(bench):
            bench.measure("drift", math.nan, "deg/h", high=0.1)


        def test_too_fast_is_refused(bench):
            bench.run("constant-rotation", rate_dps=500, turns=1, rest_s=10)


        def test_an_installed_procedure(bench):
            assert bench.run("constant-rotation", rate_dps=12, turns=1, rest_s=10).outcome == "completed"
        """
    )
    result.assert_outcomes(passed=2, failed=4)
    result.stdout.fnmatch_lines(
        [
            "*outside its limits: impossible: 20 <= * deg/s*",
            "*drift: 0.3 <= 0.1 deg/h*",
            "*drift: nan <= 0.1 deg/h*",
            "*LimitExceeded*forbids*Found: 500 deg/s.*",
        ]
    )
    drive = properties["test_drive"]
    assert float(drive["rate"]) == pytest.approx(10.0, abs=0.05)
    assert (drive["rate.unit"], drive["rate.low"], drive["rate.high"]) == ("deg/s", "9.9", "10.1")
    assert (drive["rate.passed"], drive["impossible.passed"]) == ("True", "False")
    assert drive["run_outcome"] == "completed" and "scale_error" in drive
    failed = properties["test_a_measurement_outside_fails"]
    assert failed["impossible.passed"] == "False" and float(failed["rate"]) == float(drive["rate"])
    assert "run_outcome" not in properties["test_too_fast_is_refused"]  # no run was begun


def test_a_bench_file_is_driven_and_an_unprepared_one_is_not(inner, tmp_path):
    from bench.lab.emulated import EmulatedLab, Plant
    from bench.lab.testing import usual_bench
    from bench.record.benchfile import bench_file_text

    source = """
        def look(bench):
            bench.ask("Ready?")
            bench.wait(5.0, "looking")


        def test_it(bench):
            assert not bench.emulated
            bench.drive(look)
        """
    path = tmp_path / "lab.toml"
    with EmulatedLab(
        usual_bench(None), Plant(), apart=True
    ) as lab:  # stands for devices: known by its ports only
        path.write_text(bench_file_text(lab.file))
        result, _ = inner(source, "--bench", str(path), "--bench-runs", str(tmp_path / "runs"))
        result.assert_outcomes(failed=1)
        result.stdout.fnmatch_lines(["*nobody is there*Ready?*--bench-yes*"])
        result, properties = inner(
            source, "--bench", str(path), "--bench-yes", "--bench-runs", str(tmp_path / "runs")
        )
        result.assert_outcomes(passed=1)
    folders = sorted(run.name for run in (tmp_path / "runs").iterdir())
    assert len(folders) == 2 and properties["test_it"]["run_folder"].endswith(folders[1])


def test_a_bench_file_with_a_mistake_is_an_error_of_the_test(inner, tmp_path):
    (tmp_path / "lab.toml").write_text("[bench]\n")
    result, _ = inner("def test_it(bench): pass", "--bench", str(tmp_path / "lab.toml"))
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*mistakes in the bench file*"])


def test_a_folder_that_hides_a_room_is_named_in_one_sentence(pytester):
    hiding = pytester.mkpydir("drivers")
    pytester.makepyfile("import drivers\n\ndef test_it(bench): pass")
    shown = pytester.runpytest_subprocess("-p", "no:cacheprovider").stdout.str()
    sentences = [
        line for line in shown.splitlines() if line.startswith(f"{hiding} hides the package 'drivers'")
    ]
    assert len(sentences) == 1 and "Traceback" not in shown and "_model.py" not in shown


def test_nothing_is_loaded_before_a_test_asks_for_it():
    code = """if True:
        import sys
        import bench.lab.pytest_plugin
        heavy = {"bench.control.session", "bench.lab.testing", "bench.lab.emulated", "numpy"}
        assert not heavy & set(sys.modules)
    """
    subprocess.run([sys.executable, "-c", code], check=True)
