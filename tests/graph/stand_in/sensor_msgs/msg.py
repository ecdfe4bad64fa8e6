"""Messages of the stand-in."""


class LaserScan:
    pass
