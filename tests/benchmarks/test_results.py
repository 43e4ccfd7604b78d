"""From rates to floors, ratios and splits, on numbers made by hand."""

import pytest

from benchmarks.ceilings import products
from benchmarks.results import derive, floor, mixed, shape_floor
from benchmarks.size import TINY, Size, mflop_per_step
from benchmarks.tables import markdown, table

PAPER = Size()


def record(*rounds: dict[str, float], **more) -> dict:
    parts = {
        name: {
            "work": {},
            "compile_seconds": {},
            "peak_mib": 1.0,
            "facts": {"num_seeds": 2, "devices": 2},
        }
        for name in {key.split("/")[0] for rates in rounds for key in rates}
    }
    for key in rounds[0] if rounds else ():
        parts[key.split("/")[0]]["work"][key.split("/")[1]] = 48_000
    head = {
        "date": "2026-01-02T03:04:05+00:00",
        "commit": "abc",
        "machine": {"name": "a machine"},
        "versions": {},
    }
    made = {
        **head,
        "environment": {},
        "repetitions": len(rounds),
        "seconds": 60.0,
        "cold": True,
        "load": None,
    }
    made |= {"size": {**vars(PAPER)}, "parts": parts, "rounds": list(rounds), **more}
    return made | derive(made)


def products_at(rate: float, part: str) -> dict[str, float]:
    return {f"{part}/{product.name}": rate for product in products(PAPER)}


def test_five_megaflop_a_step():
    # A policy's products 2 (35 256 + 256 128 + 128 4) = 84,480, a value's 83,712: four networks
    # 336,384 forward; their inputs' gradients, without the first layers', 4 2 256 128 + 2 2 128 (4
    # + 1) = 264,704. Five epochs:
    assert (
        mflop_per_step(PAPER)
        == (336_384 + 5 * (2 * 336_384 + 264_704)) / 1e6
        == pytest.approx(5.0, abs=0.05)
    )


def test_the_floor_takes_the_faster_library():
    assert floor({"numpy/cube": 150.0, "xla/cube": 140.0}, PAPER) == pytest.approx(
        150e9 / 5.023744e6
    )
    assert floor({"numpy/cube": 100.0, "xla/cube": 140.0}, PAPER) == pytest.approx(
        140e9 / 5.023744e6
    )


def test_where_all_shapes_run_at_one_rate_the_floor_at_the_shapes_is_the_floor():
    rates = products_at(150.0, "xla") | products_at(150.0, "numpy")
    assert shape_floor(rates, PAPER, "xla") == pytest.approx(floor(rates, PAPER))
    slow = rates | {"xla/256x128 weight gradient": 75.0}
    # That one product, 5 4 2 256 128 = 1.31 MFLOP of 5.02, takes twice its time.
    assert shape_floor(slow, PAPER, "xla") == pytest.approx(150e9 / (5.023744e6 + 1.31072e6))


def test_a_fifth_of_the_chunks_frozen_mixes_times_not_rates():
    assert mixed({"sippo/live": 10.0, "sippo/frozen": 20.0}) == pytest.approx(1 / 0.09)


def test_ratios_are_taken_within_a_round():
    # A host that slows down by half in the second round: the ratio does not notice, the rates do.
    one = {
        "step-cores/environment": 400.0,
        "step/plain data": 100.0,
        "mujoco/lean": 200.0,
        "mujoco/full": 100.0,
    }
    made = record(one, {name: rate / 2 for name, rate in one.items()})
    ratio = made["ratios"]["environment / plain mjx.Data, one program"]
    assert (ratio["min"], ratio["median"], ratio["max"], ratio["least"]) == (4.0, 4.0, 4.0, 4.0)
    assert made["rates"]["step-cores/environment"]["values"] == [400.0, 200.0]


def test_what_was_not_measured_is_left_out():
    made = record({"mujoco/lean": 2.0, "mujoco/full": 1.0})
    assert (made["ratios"], made["floors"], made["split"]) == ({}, {}, {})
    assert record()["rates"] == {}


def test_the_rest_of_an_iteration_is_what_its_pieces_leave():
    # 48,000 steps: 3 s an iteration; 0.5 s physics, 0.3 s policies, 2 s learning.
    rates = {"iteration": 16e3, "flight": 48e3, "physics": 96e3, "policy": 160e3, "learning": 24e3}
    made = record({f"ippo-seeds/{name}": rate for name, rate in rates.items()})
    assert made["split"]["ippo-seeds"]["rest"]["median"] == pytest.approx(200.0)
    assert "3,000" in markdown(made) and "2,000 (67%)" in markdown(made)


def test_targets_say_whether_they_were_reached():
    starts = {"cold": dict.fromkeys(("compiling_at", "compile_seconds", "first_line_at"), 31.0)}
    text = markdown(record({"step-cores/environment": 360e3}, start=starts))
    (environment,) = (line for line in text.splitlines() if line.startswith("| environment alone"))
    (cold,) = (line for line in text.splitlines() if line.startswith("| cold"))
    assert [cell.strip() for cell in environment.split("|")[3:5]] == ["350,000", "yes"]
    assert [cell.strip() for cell in cold.split("|")[4:7]] == ["31.0", "30", "no"]


def test_columns_of_a_table_line_up():
    lines = table(("", "rate"), [("one", "1"), ("a longer name", "1,000,000")]).splitlines()
    assert len({len(line) for line in lines}) == 1
    assert lines[1].endswith("-: |") and lines[2].endswith("         1 |")


def test_a_size_survives_its_trip_to_a_worker():
    assert Size.from_json(TINY.to_json()) == TINY
