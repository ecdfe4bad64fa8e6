"""Messages of the stand-in."""

from types import SimpleNamespace as Some


class Odometry:
    pass


class OccupancyGrid:
    def __init__(self):
        self.header, self.data = Some(), []
        self.info = Some(origin=Some(position=Some(), orientation=Some()))
