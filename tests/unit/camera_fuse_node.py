"""Serves the scripted camera as a device file, whose ioctls, polls and pages the kernel forwards.

Run as ``python camera_fuse_node.py MOUNTPOINT``: a process of its own, since a client's page fault
that holds the interpreter lock would wait for this code. Commands on stdin, one answer each:
``frame LEVEL STAMP_S``, ``unplug``, ``seen NAME``. Numbers and layouts: linux/fuse.h. Exit code 77
says that this user may not mount here.
"""

import ctypes
import errno
import os
import struct
import sys
import threading
import traceback

from camera_fakes import SLOT_BYTES, FakeCamera

ROOT, NODE = 1, 2
FILE_BYTES = 8 * SLOT_BYTES
LOOKUP, FORGET, GETATTR, OPEN, READ, RELEASE, FSYNC = 1, 2, 3, 14, 15, 18, 20
FLUSH, INIT, OPENDIR, RELEASEDIR = 25, 26, 27, 29
INTERRUPT, IOCTL, POLL, BATCH_FORGET = 36, 39, 40, 42
NOTIFY_POLL, NOTIFY_STORE = 1, 4
KEEP_CACHE = 2  # the pages stay as they were stored
POLL_IN, POLL_PRI, POLL_ERR, POLL_HUP = 0x41, 0x2, 0x8, 0x10
MAY_NOT_MOUNT = 77

libc = ctypes.CDLL(None, use_errno=True)


class FuseNode:
    def __init__(self, camera: FakeCamera, mountpoint: str) -> None:
        self.camera = camera
        self.fd = os.open("/dev/fuse", os.O_RDWR | os.O_CLOEXEC)
        options = f"fd={self.fd},rootmode=40000,user_id=0,group_id=0".encode()
        if libc.mount(b"camera", mountpoint.encode(), b"fuse.camera", 6, options):
            raise OSError(ctypes.get_errno(), "mount")
        self.memory = bytearray(FILE_BYTES)
        self.poll_handles: set[int] = set()
        self.lock = threading.Lock()
        camera.write, camera.changed = self.store, self.wake

    def store(self, offset: int, data: bytes) -> None:
        self.memory[offset : offset + len(data)] = data
        self.send(0, NOTIFY_STORE, struct.pack("<QQII", NODE, offset, len(data), 0) + data)

    def wake(self, _: bool) -> None:
        with self.lock:
            handles, self.poll_handles = self.poll_handles, set()
        for handle in handles:
            self.send(0, NOTIFY_POLL, struct.pack("<Q", handle))

    def send(self, unique: int, code: int, body: bytes = b"") -> None:
        try:
            os.write(self.fd, struct.pack("<IiQ", 16 + len(body), code, unique) + body)
        except OSError as error:
            if error.errno != errno.ENOENT:  # nobody waits for this any more
                raise

    def run(self) -> None:
        try:
            while True:
                request = os.read(self.fd, (1 << 20) + 8192)
                _, op, unique, node = struct.unpack_from("<IIQQ", request)
                self.serve(op, unique, node, request[40:])
        except OSError as error:
            os._exit(0 if error.errno == errno.ENODEV else 1)  # unmounted
        except BaseException:  # noqa: BLE001 -- whatever it is, see below
            traceback.print_exc()
            os._exit(1)  # a mount that nobody answers would hang its users for ever

    def serve(self, op: int, unique: int, node: int, body: bytes) -> None:
        if op in (FORGET, BATCH_FORGET, INTERRUPT):
            return
        try:
            self.send(unique, 0, self.answer(op, node, body))
        except OSError as error:
            self.send(unique, -(error.errno or errno.EIO))

    def answer(self, op: int, node: int, body: bytes) -> bytes:
        if op == INIT:  # our version is the kernel's, or 7.38
            _, minor, readahead, flags = struct.unpack_from("<IIII", body)
            head = (7, min(minor, 38), readahead, flags & (1 | 1 << 22))
            return struct.pack("<IIIIHHIIHHI28x", *head, 16, 12, 1 << 20, 1, 256, 0, 0)
        if op == LOOKUP:
            if node != ROOT or body.rstrip(b"\0") != b"video0":
                raise OSError(errno.ENOENT, "no such node")
            return struct.pack("<QQQQII", NODE, 1, 0, 3600, 0, 0) + attributes(NODE)
        if op == GETATTR:
            return struct.pack("<QII", 3600, 0, 0) + attributes(node)
        if op in (OPEN, OPENDIR):
            return struct.pack("<QII", 1, KEEP_CACHE if op == OPEN else 0, 0)
        if op == READ:  # a page that was not stored yet
            offset, size = struct.unpack_from("<QI", body, 8)
            return bytes(self.memory[offset : offset + size])
        if op == IOCTL:
            return self.ioctl(body)
        if op == POLL:
            handle, flags = struct.unpack_from("<QI", body, 8)
            with self.lock:
                if flags & 1:  # wants to be told
                    self.poll_handles.add(handle)
            return struct.pack("<II", self.poll(), 0)
        if op == RELEASE:
            self.camera.released()
        if op in (RELEASE, RELEASEDIR, FLUSH, FSYNC):
            return b""
        raise OSError(errno.ENOSYS, "not served")

    def ioctl(self, body: bytes) -> bytes:
        command, _, in_size, out_size = struct.unpack_from("<IQII", body, 12)
        buffer = bytearray(command >> 16 & 0x3FFF)
        buffer[:in_size] = body[32 : 32 + in_size]
        result = 0
        try:
            self.camera.ioctl(command, buffer)
        except OSError as error:
            result = -(error.errno or errno.EIO)
        return struct.pack("<iIII", result, 0, 0, 0) + bytes(buffer[:out_size])

    def poll(self) -> int:
        if self.camera.is_gone:
            return POLL_ERR | POLL_HUP | POLL_PRI  # 0x1a, as the real kernel
        if not self.camera.is_streaming:
            return POLL_ERR
        return POLL_IN if self.camera.done else 0


def attributes(node: int) -> bytes:
    mode, size = (0o40755, 0) if node == ROOT else (0o100666, FILE_BYTES)
    return struct.pack("<6Q10I", *(node, size, 0, 0, 0, 0), *(0, 0, 0, mode, 1, 0, 0, 0, 4096, 0))


def tell(answer: str) -> None:
    sys.stdout.write(answer + "\n")
    sys.stdout.flush()


def main(mountpoint: str, width: int, height: int) -> int:
    camera = FakeCamera(width, height)
    for control, value in ((0x0098090C, 0), (0x009A0901, 1), (0x009A0902, 100)):
        camera.controls[control].value = value
    try:
        node = FuseNode(camera, mountpoint)
    except OSError as error:
        tell(str(error))
        return MAY_NOT_MOUNT
    thread = threading.Thread(target=node.run, daemon=True)
    thread.start()
    tell("ready")
    for line in sys.stdin:
        verb, *words = line.split()
        told = "ok"
        if verb == "frame":
            told = str(camera.finish(bytes([int(words[0])]) * (width * height), float(words[1])))
        elif verb == "unplug":
            camera.unplug()
        elif verb == "seen":
            told = str(camera.seen[words[0]])
        tell(told)
    libc.umount2(mountpoint.encode(), 2)  # MNT_DETACH
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])))
