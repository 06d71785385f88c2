"""What a function takes and returns is written in its docstring, in Google style."""

import ast
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

ROOT = Path(__file__).parents[2]
TREES = {
    path: ast.parse(path.read_text())
    for folder in ("faultgen", "analysis")
    for path in sorted((ROOT / folder).rglob("*.py"))
}
ARRAYS = {"ndarray", "NDArray"}
COMMANDS = {"command", "callback"}  # the help text of the command line describes their options


def names_in(node):
    """Names in code, also within types that are written as texts."""
    for part in ast.walk(node):
        if isinstance(part, ast.Name):
            yield part.id
        elif isinstance(part, ast.Attribute):
            yield part.attr
        elif isinstance(part, ast.Constant) and isinstance(part.value, str):
            yield from re.findall(r"\w+", part.value)


def array_types(trees):
    """Names of types that are, or hold, an array: those of NumPy and what modules call so."""
    found = set(ARRAYS)
    for tree in trees:
        for node in tree.body:
            if isinstance(node, ast.Assign) and found & set(names_in(node.value)):
                if not isinstance(node.value, ast.Call):
                    found |= {name.id for name in node.targets if isinstance(name, ast.Name)}
    return found


TYPES = array_types(TREES.values())


def functions(body, owner=None, place=""):
    """Public functions, methods and constructors, with the class to which they belong."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from functions(node.body, node, f"{place}{node.name}.")
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            decorators = {name for one in node.decorator_list for name in names_in(one)}
            public = not node.name.startswith("_") or node.name == "__init__"
            if public and not decorators & COMMANDS:
                text = ast.get_docstring(node) or ""
                if node.name == "__init__":
                    text = f"{ast.get_docstring(owner) or ''}\n{text}"
                yield SimpleNamespace(
                    name=f"{place}{node.name}",
                    node=node,
                    arguments=arguments(node, owner is not None, decorators),
                    is_property=bool(decorators & {"property", "cached_property"}),
                    text=text,
                )


def arguments(node, in_class, decorators):
    """Names of the arguments that a caller gives."""
    given = node.args
    names = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    names += [one.arg for one in (given.vararg, given.kwarg) if one is not None]
    return names[1:] if in_class and "staticmethod" not in decorators else names


def section(text, title):
    """The lines of a section of a docstring; empty if it has none."""
    found = re.search(rf"^{title}:\n((?:[ ]+.*\n|\n)+)", text + "\n", re.MULTILINE)
    return found[1] if found else ""


def lacks(function):
    """What the docstring of a function does not say."""
    named = re.findall(r"^ {4}\*{0,2}(\w+):", section(function.text, "Args"), re.MULTILINE)
    if len(function.arguments) > 1:
        yield from (f"Args: {name}" for name in function.arguments if name not in named)
    yield from (f"no argument {name}" for name in named if name not in function.arguments)
    returned = function.node.returns
    if returned is not None and TYPES & set(names_in(returned)):
        told = section(function.text, "Returns") + section(function.text, "Yields")
        told = function.text if function.is_property else told
        if "shape" not in told.lower():
            yield "Returns: shape"


def undocumented_fields(body):
    """Public fields of public data classes that have no docstring, so that nothing names them."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            made = {name for one in (*node.decorator_list, *node.bases) for name in names_in(one)}
            if made & {"dataclass", "BaseModel", "NamedTuple"}:
                for field, after in zip(node.body, [*node.body[1:], None], strict=True):
                    if isinstance(field, ast.AnnAssign) and not field.target.id.startswith("_"):
                        told = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                        if not told:
                            yield f"{node.name}.{field.target.id}"


def test_docstrings_name_every_argument_and_the_shape_of_arrays():
    """Functions with two or more arguments have an Args section; arrays have their shape."""
    found = [
        f"{path.relative_to(ROOT)}:{function.node.lineno} {function.name}: {lack}"
        for path, tree in TREES.items()
        for function in functions(tree.body)
        for lack in lacks(function)
    ]
    assert not found, "\n".join(found)


def test_every_field_of_a_data_class_has_a_docstring():
    """The fields are the arguments of its constructor."""
    found = [
        f"{path.relative_to(ROOT)} {name}"
        for path, tree in TREES.items()
        for name in undocumented_fields(tree.body)
    ]
    assert not found, "\n".join(found)


GOOD = '''
Rows = np.ndarray
class Chart:
    """A chart.

    Args:
        size: Its size.
        limit: Its limit.
    """
    def __init__(self, size, limit): ...
    def add(self, x: Rows, *more: int) -> Rows:
        """Add.

        Args:
            x: Shape (n,).
            more: Others.

        Returns:
            The sum. Shape (n,).
        """
    @property
    def level(self) -> "Rows":
        """Level. Shape (n,)."""
    def _hidden(self, a, b): ...
@app.command()
def command(a, b):
    """Command."""
def single(a):
    """One argument needs no list."""
'''


def findings(source):
    tree = ast.parse(source)
    TYPES.update(array_types([tree]))
    return [lack for function in functions(tree.body) for lack in lacks(function)]


@pytest.mark.parametrize(
    ("remove", "finding"),
    [
        ("        limit: Its limit.\n", "Args: limit"),
        ("            more: Others.\n", "Args: more"),
        ("            The sum. Shape (n,).\n", "Returns: shape"),
        (' Shape (n,)."""', "Returns: shape"),
        ("@app.command()\n", "Args: a"),
        (", limit)", "no argument limit"),
    ],
)
def test_the_check_finds_what_is_missing(remove, finding):
    assert findings(GOOD) == []
    assert remove in GOOD
    replacement = ")" if remove == ", limit)" else '"""' if '"""' in remove else ""
    assert finding in findings(GOOD.replace(remove, replacement))
