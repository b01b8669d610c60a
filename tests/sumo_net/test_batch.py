"""Arrays with a row for each handle; the way along polylines."""

import numpy as np

from sumo_net.batch import longer
from sumo_net.polyline import stations


def test_a_table_grows_to_twice_its_length_or_more_and_keeps_its_rows() -> None:
    table = np.arange(6, dtype=np.int32).reshape(3, 2)
    assert longer(table, 3) is table
    grown = longer(table, 4, -1)
    assert grown.dtype == np.int32
    np.testing.assert_array_equal(grown, [[0, 1], [2, 3], [4, 5], [-1, -1], [-1, -1], [-1, -1]])
    assert len(longer(table, 20)) == 20
    assert len(longer(np.zeros(0), 1)) == 1


def test_stations_are_the_way_along_the_line() -> None:
    np.testing.assert_allclose(stations(np.array([[1.0, 1.0], [4.0, 5.0], [4.0, 7.0]])), [0.0, 5.0, 7.0])
