"""What the wheel computes: `python -m unittest discover python/tests`, where the wheel is installed."""

import math
import tempfile
import unittest
from pathlib import Path

import numpy as np

import echogrid

BEARINGS = np.radians(np.arange(360) - 179.5)
LIDAR = echogrid.Robot("disc", [echogrid.lidar(0, 0, 0, 360, BEARINGS[0], BEARINGS[1] - BEARINGS[0])])


def room(x):
    """Ranges from (x, 2) to the walls of a room of 6 m by 4 m."""
    to_x = np.where(np.cos(BEARINGS) > 0, 6 - x, -x) / np.cos(BEARINGS)
    to_y = np.where(np.sin(BEARINGS) > 0, 2, -2) / np.sin(BEARINGS)
    return np.minimum(to_x, to_y)


def mapped():
    mapper = echogrid.GridMapper(LIDAR, resolution_m=0.05)
    for step, x in enumerate(np.linspace(1, 5, 50)):
        verdicts = mapper.scan((x, 2.0, 0.0), room(x), stamp=step * 0.1)
        assert len(verdicts) == 360
    return mapper


def at(grid, x, y):
    left, low = grid.origin
    return grid.probability[int((y - low) / grid.resolution), int((x - left) / grid.resolution)]


class Core(unittest.TestCase):
    def test_a_map_of_arrays_shows_the_room(self):
        grid = mapped().grid()
        for x in np.arange(0.5, 5.6, 0.5):
            self.assertLess(at(grid, x, 2.0), 0.3)
            self.assertGreater(np.nanmax([at(grid, x, wall) for wall in (3.96, 4.01, 4.04)]), 0.65)
        self.assertTrue(math.isnan(at(grid, 3.0, 4.5)), "nothing is known behind the walls")
        left, right, low, high = grid.extent
        self.assertAlmostEqual(right - left, grid.probability.shape[1] * grid.resolution)
        self.assertAlmostEqual(high - low, grid.probability.shape[0] * grid.resolution)

    def test_the_same_readings_give_the_same_file_and_it_is_read_as_it_was(self):
        with tempfile.TemporaryDirectory() as folder:
            first, second = Path(folder, "first.echogrid"), Path(folder, "second.echogrid")
            mapper = mapped()
            mapper.save(first)
            mapped().save(second)
            self.assertEqual(first.read_bytes(), second.read_bytes())
            saved = echogrid.read_map(first)
            np.testing.assert_array_equal(saved.grid.log_odds, mapper.grid().log_odds)
            self.assertEqual(len(saved.path), 50)
            self.assertAlmostEqual(saved.path[-1].stamp, 4.9)
            self.assertEqual(saved.path[0].x, 1.0)

    def test_a_good_map_scores_better_than_one_that_is_moved(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "map.echogrid")
            mapped().save(path)
            yaml, image = Path(folder, "room.yaml"), Path(folder, "room.pgm")
            cells = np.full((100, 140), 254, np.uint8)
            cells[[9, 90], 9:131] = 0
            cells[9:91, [9, 130]] = 0
            image.write_bytes(b"P5 140 100 255\n" + cells.tobytes())
            text = "image: room.pgm\nresolution: 0.05\norigin: [{}, -0.5, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
            yaml.write_text(text.format(-0.5))
            good = echogrid.score(path, yaml)
            yaml.write_text(text.format(-0.1))
            moved = echogrid.score(path, yaml)
            self.assertGreater(moved["bits"], good["bits"] + 0.05)

    def test_odometry_grows_less_sure(self):
        odometry = echogrid.Odometry(k_ll=0.01, k_tt=0.01)
        sure = odometry.step(0.0, 0.0, 0.0)
        unsure = odometry.step(5.0, 0.0, 0.0)
        self.assertEqual(unsure.pose[1:], (0.0, 0.0))
        self.assertGreater(np.trace(unsure.covariance), np.trace(sure.covariance))
        # What is less sure moves cells less.
        robot = echogrid.Robot("one", [echogrid.sonar(0, 0, 0)])
        of = [echogrid.GridMapper(robot, fusion="covariance") for _ in range(2)]
        for mapper, estimate in zip(of, (echogrid.Estimate(0, 0, 0), echogrid.Estimate(0, 0, 0, np.diag([0.3, 0.3, 0.1])))):
            self.assertEqual(mapper.scan(estimate, [2.0]), ["accepted"])
        strength = [np.nansum(np.abs(mapper.grid().log_odds)) for mapper in of]
        self.assertGreater(strength[0], strength[1])

    def test_what_is_wrong_is_said(self):
        for said, call in {
            'unknown setting "resolution"': lambda: echogrid.GridMapper(LIDAR, resolution=0.1),
            "resolution_m": lambda: echogrid.GridMapper(LIDAR, resolution_m=-1.0),
            "expected finite": lambda: mapped().scan((math.nan, 0, 0), []),
            "transducer 360: the robot has 360": lambda: mapped().scan((0, 0, 0), {360: 1.0}),
            "no-such.echogrid": lambda: echogrid.read_map("no-such.echogrid"),
        }.items():
            with self.assertRaisesRegex(ValueError, said):
                call()


if __name__ == "__main__":
    unittest.main()
