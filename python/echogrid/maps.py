"""The map of a running graph, as arrays."""

import ctypes
import time

from . import layouts
from .graph import END, Domain, Input, running_domain
from .grid import Grid

TILE = 64
_TELL_EVERYTHING = 7


class MapListener:
    """Looks on while a graph maps; nobody waits for it. Iterating gives a `Grid` after each change, until the stream ends."""

    def __init__(self, domain=None, mapper="mapper"):
        self._domain = Domain(domain or running_domain())
        self._input = Input(self._domain, "map/tiles")
        self._tiles, self.resolution, self._over = {}, 0.0, False
        self._tell_everything(mapper)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return False

    def _tell_everything(self, mapper):
        """Tiles that do not change any more were told before this came: the mapper is asked for all."""
        import iceoryx2 as iox2

        name = f"control/{mapper}"
        orders = self._domain._service(name).request_response(layouts.ControlRequest, layouts.ControlReply).open()
        client = orders.client_builder().create()
        self._client = client
        request = layouts.ControlRequest(id=time.time_ns(), command=_TELL_EVERYTHING)
        client.loan_uninit().write_payload(request).send()
        self._domain.event(name).notifier_builder().create().notify_with_custom_event_id(iox2.EventId.new(0))

    def update(self, patience=0.5):
        """Takes in what comes within `patience` seconds; whether the map changed."""
        self._input.wait(patience)
        changed = False
        for header, payload in self._input:
            if header.flags & END:
                self._over = True
                continue
            tile = payload.contents
            known = self._tiles.get((tile.tile_x, tile.tile_y))
            if header.flags or tile.layer != 0 or (known and known[0] >= tile.revision):
                continue
            self.resolution, changed = tile.resolution_m, True
            self._tiles[tile.tile_x, tile.tile_y] = (tile.revision, ctypes.string_at(tile.log_odds, 4 * TILE * TILE))
        return changed

    def grid(self):
        """The map as it is now; none before the first tile."""
        import numpy

        if not self._tiles:
            return None
        left, low = (min(place[axis] for place in self._tiles) for axis in (0, 1))
        right, high = (max(place[axis] for place in self._tiles) for axis in (0, 1))
        shape = ((high - low + 1) * TILE, (right - left + 1) * TILE)
        log_odds = numpy.full(shape, numpy.nan, dtype=numpy.float32)
        for (x, y), (_, raw) in self._tiles.items():
            row, column = (y - low) * TILE, (x - left) * TILE
            log_odds[row : row + TILE, column : column + TILE] = numpy.frombuffer(raw, numpy.float32).reshape(TILE, TILE)
        return Grid(log_odds, (left * TILE * self.resolution, low * TILE * self.resolution), self.resolution)

    def __iter__(self):
        while not self._over:
            if self.update() or self._over:
                if (grid := self.grid()) is not None:
                    yield grid
            elif not self._domain.folder.exists():
                return
