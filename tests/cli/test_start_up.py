"""A command that only explains itself or refuses its input does not import heavy packages."""

import ast
import subprocess
import sys

import pytest

HEAVY = (
    *("mujoco", "pandas", "sklearn", "statsmodels", "matplotlib", "plotly", "joblib"),
    *("scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate", "scipy.linalg"),
)
"""Each of these takes 0.3 to 3 s of processor time."""


def loaded(*arguments, cwd):
    """Status, messages and imported heavy packages of a call of the command line."""
    code = (
        "import atexit, sys\n"
        f"atexit.register(lambda: print([name for name in {HEAVY} if name in sys.modules]))\n"
        f"sys.argv = ['faultgen', *{arguments!r}]\n"
        "from faultgen.cli import main\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=cwd, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stderr, ast.literal_eval(done.stdout.splitlines()[-1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("import nothing.csv --preset mat", "no such file"),
        ("import log.csv --preset ur_rtde", "no column 'actual_q_{axis}'"),
        ("import log.csv --map map.toml", "side"),
        ("import log.csv --preset nope", "unknown"),
        ("import log.csv --preset mat -o out.txt", "ends with .h5"),
        ("import bad.npz --preset mat", "cannot be read"),
        ("import bad.mat --preset mat", "cannot be read"),
        ("discover nothing.h5 --robot puma560", "no such file"),
        ("discover bad.h5 --robot puma560", "is no recording"),
        ("discover bad.h5 --robot nobody", "unknown robot 'nobody'"),
        ("calibrate nothing.h5 --robot puma560", "no such file"),
        ("twin nothing.h5 --robot puma560", "no such file"),
        ("train nowhere", "no such file or folder"),
        ("judge nowhere new.h5", "no such folder"),
        ("detect nowhere", "no such file or folder"),
        ("report nowhere", "no such file or folder"),
        ("study magic", "unknown study 'magic'"),
        ("generate nothing.toml", "cannot be read"),
        ("generate --robot nobody --task spot_weld", "unknown robot"),
        ("robot build nothing.urdf", "does not exist"),
        ("robot check nobody", "unknown robot 'nobody'"),
        ("export nothing.h5", "no such file"),
        ("fleet nothing.toml", "cannot be read"),
        ("view nobody", "unknown robot 'nobody'"),
        ("explore nobody", "unknown robot 'nobody'"),
    ],
)
def test_refusals_are_quick(tmp_path, arguments, message):
    """They import neither the simulator nor the packages for analysis and figures."""
    (tmp_path / "log.csv").write_text("a,b\n1,2\n3,4\n")
    (tmp_path / "map.toml").write_text("side = 1\n")
    for name in ("bad.npz", "bad.mat", "bad.h5"):
        (tmp_path / name).write_text("PK no such thing")
    status, error, packages = loaded(*arguments.split(), cwd=tmp_path)
    assert status == 2 and message in error and error.count("\n") == 1
    assert packages == []


@pytest.mark.parametrize(
    ("arguments", "needed"),
    [
        ("--version", set()),
        ("tasks", set()),
        ("robots", {"mujoco"}),
        ("effects", {"mujoco"}),
        ("import log.csv --map plain.toml -o out.h5", {"pandas"}),
    ],
)
def test_quick_commands_import_only_what_they_need(tmp_path, arguments, needed):
    """benchmarks/speed/command_speed.py measures the processor time that they take."""
    rows = "\n".join(f"{0.01 * k},{k % 9},{k % 7}" for k in range(50))
    (tmp_path / "log.csv").write_text(f"t,q1,u1\n{rows}\n")
    (tmp_path / "plain.toml").write_text(
        'side = "joint"\ntime = { column = "t", unit = "s" }\n'
        'position = { columns = "q{axis}", unit = "rad" }\n'
        'torque = { columns = "u{axis}", unit = "Nm" }\n'
    )
    status, error, packages = loaded(*arguments.split(), cwd=tmp_path)
    assert status == 0, error
    assert set(packages) <= needed


def test_judging_needs_neither_scikit_learn_nor_figures(twin, tmp_path):
    """The part of the detector that judges is apart from that which learns."""
    folder, files = twin
    arguments = ("judge", folder / "detector", files["healthy"], "--state", tmp_path / "s.sqlite")
    status, error, packages = loaded(*map(str, arguments), cwd=tmp_path)
    assert status == 0, error
    heavy = {"sklearn", "pandas", "statsmodels", "matplotlib", "plotly", "scipy.signal"}
    assert not heavy & set(packages)


def test_help_is_quick(tmp_path):
    """The help of every command, and the list of commands."""
    from faultgen.cli.app import app

    names = [one.name or one.callback.__name__.rstrip("_") for one in app.registered_commands]
    assert {"import", "discover", "judge"} <= set(names)
    for group in app.registered_groups:
        names += [group.name or group.typer_instance.info.name]
    code = (
        "import sys\n"
        "from typer.testing import CliRunner\n"
        "from faultgen.cli import app\n"
        f"for name in {['', *names]!r}:\n"
        "    done = CliRunner().invoke(app, [*name.split(), '--help'])\n"
        "    assert done.exit_code == 0, (name, done.output)\n"
        f"print([name for name in {HEAVY} if name in sys.modules])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert ast.literal_eval(done.stdout.splitlines()[-1]) == []


def test_a_function_is_not_hidden_by_the_module_of_its_name():
    """`faultgen.discover` is the function, whichever of the two is imported first."""
    code = (
        "import faultgen.discovery.replay as module, types\n"
        "import faultgen.report.discover\n"
        "from faultgen import discover\n"
        "assert isinstance(module, types.ModuleType) and callable(discover), (module, discover)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
