"""The table of faults names tests; this proves that they are there, and that no fault is without
one.
"""

import re
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
TABLE = (REPOSITORY / "docs" / "faults.md").read_text()


def test_every_test_that_the_table_names_exists():
    defined = {
        name
        for path in (REPOSITORY / "tests").rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", path.read_text(), re.MULTILINE)
    }
    named = set(re.findall(r"`(test_\w+)`", TABLE))
    assert len(named) > 80 and named - defined == set()


def test_every_fault_has_its_row():
    rows = [line.split("|") for line in TABLE.splitlines() if re.match(r"\| \d", line)]
    assert {int(number) for _, number, *_ in rows} == set(range(1, 41))
    assert all("`test_" in tests for *_, tests, _ in rows)
