"""How the checkpoints fly, as a figure and a table."""

import numpy as np
from flown import rows as rows_of
from matplotlib.text import Text

from dronecombat_jax.files.plain import records
from dronecombat_jax.report.flight_figure import PANELS, flight_over_time, flight_table


def test_every_panel_has_a_line_a_method_and_role_over_the_chunks_of_all_seeds():
    rows = rows_of(3)[:-1]  # the last seed of the last method lacks its last chunk
    figure = flight_over_time(rows)
    figure.draw_without_rendering()
    told = " ".join(str(text.get_text()) for text in figure.findobj(Text)).replace("\n", " ")
    assert (
        "Training seeds: ippo 2, s-ippo 2." in told
        and "88 recorded fights (8 of each pair)" in told
    )
    for ax, (heading, unit) in zip(figure.axes, PANELS.values(), strict=True):
        assert (ax.get_title(), ax.get_ylabel()) == (heading, unit)
    closing, altitude = figure.axes[1], figure.axes[3]
    assert [line.get_label() for line in closing.lines] == ["ippo: both", "s-ippo: both"]
    assert len(altitude.lines) == 4
    # ippo's seeds close at 1 and 2 m/s, ten times the chunk faster; s-ippo's mean ends where a seed
    # does.
    np.testing.assert_allclose(np.asarray(closing.lines[0].get_ydata()), [11.5, 21.5, 31.5])
    np.testing.assert_allclose(np.asarray(closing.lines[1].get_xdata()), [1000, 2000])
    assert np.asarray(figure.axes[2].lines[0].get_ydata())[0] == 90.0  # degrees


def test_the_table_has_one_number_a_column():
    told = records(flight_table(rows_of(1)))
    assert len(told["rows"]) == 4
    assert (
        told["rows"][0]["defender_altitude"] == 1.5 and told["rows"][0]["attacker_altitude"] == 2.5
    )
