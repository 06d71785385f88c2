"""The command line. Results go to stdout, progress and messages to stderr.

The exit status is 0 when the command is done, 1 when it failed while running, 2 when the input is
wrong (with one line that says why), 130 when it was interrupted and 143 when it was terminated.
"""

from __future__ import annotations

import os
import sys

from faultgen.cli import (
    data,
    discovery,
    explore,
    export,
    fleet,
    info,
    judge,
    lists,
    machine,
    recordings,
    robot,
    twin,
    view,
)
from faultgen.cli.app import app
from faultgen.errors import InputError, MethodFailed, SimulationFailed, StorageFailed, one_line
from faultgen.system.interrupts import close, listen
from faultgen.system.terminal import note, print_messages

__all__ = [
    "data",
    "discovery",
    "explore",
    "export",
    "fleet",
    "info",
    "judge",
    "lists",
    "machine",
    "main",
    "recordings",
    "robot",
    "twin",
    "view",
]

_INTERRUPTED = 130


RENAMED = {"--width": "--prior-scale", "--steady": "--white-noise"}
"""New names of options that once had another name."""
_NUMBER = "Input should be a valid {0}, unable to parse string as {1} {0}"
_PLAINER = {
    _NUMBER.format("integer", "an"): "must be a whole number",
    _NUMBER.format("number", "a"): "must be a number",
}


def main() -> None:
    """Run the command line and exit with its status."""
    # when interrupted, two processes of joblib may clear up the same folder, and one complains
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
    listen()
    print_messages()
    try:
        status = app(standalone_mode=False)
        if status == _INTERRUPTED:  # the command-line library has caught Ctrl-C
            raise KeyboardInterrupt
        close()
        parallel = sys.modules.get("faultgen.system.parallel")  # loaded only if it was needed
        if parallel is not None:
            parallel.end_workers()
    except InputError as error:
        _fail(str(error), 2)
    except SystemExit:
        close()
        raise
    except KeyboardInterrupt:
        _fail("interrupted; run the same command again to continue", _INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except StorageFailed as error:
        _fail(f"{error}; check the disk, then run the same command again to continue", 1)
    except (NotADirectoryError, FileExistsError) as error:
        _fail(f"{error.filename}: a file is where a folder has to be; choose another name", 2)
    except OSError as error:
        named = error.filename is not None and error.strerror
        _fail(f"{error.filename}: {error.strerror}" if named else one_line(error), 1)
    except (SimulationFailed, MethodFailed) as error:
        _fail(one_line(error), 1)
    except Exception as error:
        # usage errors of the command-line library
        if not hasattr(error, "format_message"):
            raise
        message = error.format_message()
        if message.startswith("Usage:"):  # no command given: the help page
            print(message)
            sys.exit(2)
        renamed = RENAMED.get(getattr(error, "option_name", ""))
        message = " ".join(message.split())
        for said, plainer in _PLAINER.items():
            message = message.replace(f": {said}", f": it {plainer}")
        if renamed:
            message = f"{message.removesuffix('.')}; it is now called {renamed}"
        _fail(message, 2)
    sys.exit(status if isinstance(status, int) else 0)


def _fail(message: str, status: int) -> None:
    close()
    note(message)
    sys.exit(status)
