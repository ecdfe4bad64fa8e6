"""A map as an array."""


class Grid:
    """A map: log-odds of every cell, NaN where nothing is known. Row 0 is the lowest y, column 0 the lowest x.

    `origin` is the lower left corner of cell [0, 0] in the map frame, `resolution` the side of a cell, both metres.
    """

    def __init__(self, log_odds, origin, resolution):
        self.log_odds, self.origin, self.resolution = log_odds, origin, resolution

    @property
    def probability(self):
        """How probably each cell is occupied; NaN where nothing is known."""
        import numpy

        return 1.0 / (1.0 + numpy.exp(-self.log_odds.astype(float)))

    @property
    def extent(self):
        """For matplotlib's `imshow(…, origin="lower", extent=…)`."""
        rows, columns = self.log_odds.shape
        x, y = self.origin
        return (x, x + columns * self.resolution, y, y + rows * self.resolution)
