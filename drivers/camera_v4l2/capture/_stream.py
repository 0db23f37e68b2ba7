"""The ring of mapped buffers: made, filled, emptied and always unmapped. Blocking."""

import contextlib
import errno

from drivers.errors import BadReplyError, RefusedError
from messages import say

from ..kernel import BufferMap, Device
from ..kernel.abi import Buffer


class Stream:
    """The buffers of one open camera.

    The maps stay in our hands: each holds a duplicate of the node's descriptor, and a camera that
    was unplugged comes back under another number while one of them is open.

    Parameters
    ----------
    device : the open camera, its format set
    buffer_count : number of buffers to request
    """

    def __init__(self, device: Device, buffer_count: int) -> None:
        self._device = device
        self._wanted_count = buffer_count
        self._maps: list[BufferMap] = []

    @property
    def buffer_count(self) -> int:
        """Buffers the camera granted."""
        return len(self._maps)

    def start(self) -> None:
        """Get and map buffers, queue them, start the frames.

        Raises
        ------
        OSError : from the camera
        RefusedError : fewer than two buffers granted
        BadReplyError : a buffer that cannot be mapped
        """
        count = self._device.request_buffers(self._wanted_count)
        if count < 2:
            raise RefusedError(
                say(
                    "camera {path}: {count} buffers granted of {wanted_count}",
                    path=self._device.path,
                    count=count,
                    wanted_count=self._wanted_count,
                ),
                errno.ENOMEM,
            )
        for index in range(count):
            place = self._device.query_buffer(index)
            try:
                self._maps.append(self._device.mmap(place.length, place.offset))
            except ValueError as error:  # a length or offset that the memory does not have
                raise BadReplyError(
                    say(
                        "camera {path}: buffer {index} of {length} bytes at {offset}: {error}",
                        path=self._device.path,
                        index=index,
                        length=place.length,
                        offset=place.offset,
                        error=error,
                    )
                ) from error
        self.resume()

    def resume(self) -> None:
        """Queue all buffers and start the frames."""
        for index in range(len(self._maps)):
            self._device.queue(index)
        self._device.stream_on()

    def pause(self) -> None:
        """Stop the frames; the buffers stay."""
        self._device.stream_off()

    def restart(self) -> None:
        """Start over from nothing after an I/O error."""
        with contextlib.suppress(OSError):  # what matters is whether the start succeeds
            self._device.stream_off()
        self.unmap()
        self._device.request_buffers(0)
        self.start()

    def read(self, buffer: Buffer) -> bytes:
        """Return a copy of a dequeued buffer's bytes."""
        return self._maps[buffer.index][: buffer.bytesused]

    def unmap(self) -> None:
        """Release the maps."""
        while self._maps:
            self._maps.pop().close()

    def abandon(self) -> None:
        """Stop and unmap, even if a step fails: the camera may be gone."""
        with contextlib.suppress(OSError):
            self._device.stream_off()
        self.unmap()
