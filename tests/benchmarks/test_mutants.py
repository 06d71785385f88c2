"""The mutation run changes what it says that it changes, and its table names what there is."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from cosmic_ray.mutating import mutate_code
from mutation.mutants import RemoveStatement, RemoveTerm, draw_mutants

ROOT = Path(__file__).parents[2]

SOURCE = '''
from __future__ import annotations

LIMIT: float | None = 3.0

@decorated(frozen=True)
def total(values: list[int] | None, *, largest: int = 7) -> int | None:
    """Sum of a - b, and of 1."""
    found = 0
    for value in values or []:
        if value < largest and not value == 3:
            found += value * 2 - 1
    log(found)
    return found
'''


@pytest.mark.parametrize("operator", [RemoveTerm, RemoveStatement])
def test_operators_do_as_their_examples_say(operator):
    for example in operator.examples():
        changed = mutate_code(example.pre_mutation_code, operator(), example.occurrence)
        assert changed.strip() == example.post_mutation_code.strip()


def test_mutants_differ_in_one_place_that_a_test_can_notice():
    """Every mutant compiles; annotations, decorators, docstrings and bare stars stay."""
    mutants = draw_mutants(SOURCE, 1000, np.random.default_rng(0))
    lines = SOURCE.splitlines()
    for mutant in mutants:
        compile(mutant.source, "mutant", "exec")
        changed = mutant.source.splitlines()
        different = [k + 1 for k, (a, b) in enumerate(zip(lines, changed, strict=True)) if a != b]
        assert different == [mutant.line], mutant
        assert (mutant.before, mutant.after) == (
            lines[mutant.line - 1].strip(),
            changed[mutant.line - 1].strip(),
        )
    assert {mutant.line for mutant in mutants} == {4, 7, 9, 10, 11, 12, 13}
    assert all("list[int] | None, *, largest" in mutant.source for mutant in mutants)


def test_all_kinds_are_drawn_and_a_seed_gives_the_same_mutants():
    drawn = [draw_mutants(SOURCE, 6, np.random.default_rng(seed)) for seed in (*range(40), 0)]
    assert drawn[0] == drawn[-1] != drawn[1]
    assert all(len({mutant.source for mutant in mutants}) == 6 for mutants in drawn)
    assert {mutant.kind for mutants in drawn for mutant in mutants} == {
        "arithmetic",
        "comparison",
        "number",
        "logic",
        "loop",
        "term removed",
        "statement removed",
    }


def test_the_table_names_modules_and_tests_that_there_are():
    """Every module of every group has tests."""
    table = tomllib.loads((ROOT / "benchmarks" / "mutation" / "mutation.toml").read_text())
    assert table.pop("seed") >= 0
    assert table.pop("mutants") > 0
    assert list(table) == ["physics", "isolation", "discovery", "monitoring", "storage", "fleet"]
    for modules in table.values():
        for module, tests in modules.items():
            assert (ROOT / module).is_file(), module
            assert tests, module
            for name in tests:
                file, _, test = name.partition("::")
                text = (ROOT / "tests" / file).read_text()
                assert not test or f"def {test.partition('[')[0]}(" in text, name
