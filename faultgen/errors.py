"""The errors that faultgen raises for its users."""


class InputError(ValueError):
    """The user's input is wrong.

    The message is one line. It states what is wrong, where it is, and what would be right.
    """


class SimulationFailed(RuntimeError):
    """A simulation diverged, or was stopped by MuJoCo. The message states when and why."""


class WorkerKilled(SimulationFailed):
    """A process that did a part of the work was killed. The message is one line."""


class MethodFailed(RuntimeError):
    """The code of an isolator or detector raised an error. The message is one line."""


class StorageFailed(OSError):
    """A file could not be written, or does not hold what was written. The message is one line."""


def one_line(error: object) -> str:
    """Write the message of an error of other code in one line."""
    return " ".join(str(error).split())


def objection(kind: str, message: str) -> str:
    """Write what pydantic says of an entry of a file in plain words.

    Args:
        kind: Its type of the error, such as "extra_forbidden".
        message: Its message.
    """
    if kind == "extra_forbidden":
        return "there is no such entry"
    message = message.removeprefix("Value error, ")
    return message[:1].lower() + message[1:]


def what_it_says(error: BaseException) -> str:
    """Write an error of other code in one line: its type and its message."""
    return one_line(f"{type(error).__name__}: {error}")
