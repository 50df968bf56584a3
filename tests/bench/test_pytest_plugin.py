"""The pytest plugin in a project of somebody else, and the examples of the pages."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from arva_hil import Bench
from arva_hil.bench.control import ControlServer
from arva_hil.clock import RealClock
from tests.cli.far_ends import UNDER_TEST

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples" / "driver"
PLUGIN = ("-p", "arva_hil.bench.pytest_plugin", "-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:cov")


def test_a_project_chooses_its_scenario_and_a_wrong_one_fails_with_its_place(pytester: pytest.Pytester) -> None:
    pytester.makeini("[pytest]\narva_scenario = near.yaml")
    (pytester.path / "near.yaml").write_text("transmitters: [{id: 9, enu: [0, 4, 0]}]")
    (pytester.path / "wrong.yaml").write_text("transmitters: [{id: 1, enuu: [1, 2, 3]}]")
    pytester.makepyfile(
        """
        def test_near(arva_bench):
            assert arva_bench.truth().ranges_m == {9: 5.0}

        def test_other(arva_bench_factory):
            one, two = arva_bench_factory(), arva_bench_factory(port="memory")
            assert one.port != two.port
        """
    )
    pytester.runpytest_inprocess(*PLUGIN).assert_outcomes(passed=2)
    result = pytester.runpytest_inprocess(*PLUGIN, "--arva-scenario", "wrong.yaml", "-k", "near")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["wrong.yaml:1:24: unknown key 'enuu'*"])
    result.stdout.no_fnmatch_line("*Traceback*")


def test_the_plugin_imports_nothing_of_the_program() -> None:
    program = (
        "import pytest, sys; a = {*sys.modules}; import arva_hil.bench.pytest_plugin as _; print({*sys.modules} - a)"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert ast.literal_eval(ran.stdout) == {"arva_hil", "arva_hil.bench", "arva_hil.bench.pytest_plugin"}


def test_the_cpp_example_drives_a_bench(tmp_path: Path) -> None:
    wire, built = ROOT / "firmware_proto" / "c", str(tmp_path / "driver_test")
    sources = [str(EXAMPLES / "driver_test.cpp"), str(wire / "arva_frame.c")]
    subprocess.run(["g++", "-Wall", "-Wextra", "-Werror", f"-I{wire}", *sources, "-o", built], check=True)
    with Bench(port="tcp") as bench, closing(ControlServer(bench, "tcp:127.0.0.1:0")) as server:
        clock = RealClock()
        ports = [url.rpartition(":")[2] for url in (server.address, bench.port)]
        with subprocess.Popen([built, *ports], stdout=subprocess.PIPE, text=True) as test:
            while test.poll() is None:
                server.service(clock)
                clock.wait(clock.now() + 0.05, server.links)
            assert test.stdout is not None
            assert (test.stdout.read(), test.returncode) == ("near: ok, silent: ok\n", 0)


def test_the_shell_example_reads_two_frames(tmp_path: Path) -> None:
    programs = f"{Path(UNDER_TEST or sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {"PATH": programs, "HOME": str(tmp_path), "TMPDIR": str(tmp_path)}
    counted = ["bash", str(EXAMPLES / "driver_test.sh"), "bash", "-c", 'head -c 66 "$0" | wc -c']
    shell = subprocess.run(counted, capture_output=True, text=True, env=environment, timeout=60)
    assert (shell.stdout.strip(), shell.returncode) == ("66", 0), shell.stderr


def test_the_lua_example_tests_a_driver_in_a_simulator(tmp_path: Path) -> None:
    """`ARDUCOPTER` names a stand-in here; the example has passed with ArduPilot's own simulator."""
    simulator = f"{sys.executable} -m tests.bench.stand_in_arducopter"
    environment = {
        **os.environ,
        "ARDUCOPTER": os.environ.get("ARVA_HIL_ARDUCOPTER", simulator),
        "PYTHONPATH": str(ROOT),
    }
    example = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(EXAMPLES / "test_lua_driver.py")]
    ran = subprocess.run(example, cwd=tmp_path, capture_output=True, text=True, env=environment, timeout=120)
    assert "1 passed" in ran.stdout, ran.stdout + ran.stderr
