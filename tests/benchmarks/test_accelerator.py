"""The sizes that `benchmarks.accelerator` is given, and the tables it prints."""

import pytest

from benchmarks.accelerator import markdown, trained
from benchmarks.size import TINY


def test_a_size_names_seeds_environments_and_how_many_seeds_at_once():
    size = trained(TINY, "8x1000/2")
    assert (size.seeds, size.num_envs, size.seeds_at_once) == (8, 1000, 2)
    assert trained(TINY, "8x1000").seeds_at_once == 0
    assert size.config(8).run.seeds_at_once == 2


@pytest.mark.parametrize("word", ["8", "8x", "x1000", "8x1000/", "8 x 1000"])
def test_what_is_no_size_is_one_line(word):
    with pytest.raises(SystemExit, match="SEEDSxENVIRONMENTS is wanted"):
        trained(TINY, word)


def test_tables_show_every_program_of_a_part_and_leave_out_a_part_that_did_not_run():
    row = {
        "what": "step",
        "size": "1000",
        "rates": {"a": 1e6, "b": 2e3},
        "compile_seconds": {"a": 1.4, "b": 2.0},
    }
    record = {
        "date": "today",
        "commit": "c0ffee",
        "machine": {"name": "m"},
        "versions": {"jax": "0"},
        "environment": {"XLA_FLAGS": "--f", "DRONECOMBAT_CACHE": "/c"},
        "rows": [{**row, "facts": {"kind": "some device"}}],
    }
    text = markdown(record)
    assert "`XLA_FLAGS=--f`" in text and "/c" not in text and "seeds x environments" not in text
    cells = [cell.strip() for cell in text.splitlines()[-1].strip("|").split("|")]
    assert cells == ["1000", "1,000,000", "2,000", "3", "some device"]
