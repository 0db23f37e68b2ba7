"""A disk that stalls, for one process tree: a library loaded before the C library's own.

While the file named by FLAG_VARIABLE is there, writes and flushes of files below the folder of
FOLDER_VARIABLE do not return. Needs a C compiler (``cc``).
"""

import subprocess
from pathlib import Path
from typing import Final

FLAG_VARIABLE: Final = "BLIND_DISK_FLAG"
FOLDER_VARIABLE: Final = "BLIND_DISK_FOLDER"

SOURCE: Final = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static void stall(int fd) {
    const char *flag = getenv("BLIND_DISK_FLAG"), *folder = getenv("BLIND_DISK_FOLDER");
    char link[64], path[4096];
    if (!flag || !folder || access(flag, F_OK)) return;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length <= 0) return;
    path[length] = 0;
    if (strncmp(path, folder, strlen(folder))) return;
    while (!access(flag, F_OK)) usleep(5000);
}
#define REAL(name) static __typeof__(name) *real; if (!real) real = dlsym(RTLD_NEXT, #name)
ssize_t write(int fd, const void *b, size_t n) { REAL(write); stall(fd); return real(fd, b, n); }
ssize_t pwrite(int fd, const void *b, size_t n, off_t at) {
    REAL(pwrite); stall(fd); return real(fd, b, n, at);
}
ssize_t pwrite64(int fd, const void *b, size_t n, off64_t at) {
    REAL(pwrite64); stall(fd); return real(fd, b, n, at);
}
int fsync(int fd) { REAL(fsync); stall(fd); return real(fd); }
int fdatasync(int fd) { REAL(fdatasync); stall(fd); return real(fd); }
"""


def build_shim(folder: Path) -> Path:
    """Compile the library into a folder; return its path.

    Raises
    ------
    FileNotFoundError, CalledProcessError : there is no C compiler, or it fails
    """
    library = folder / "blind_disk.so"
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-O1", "-x", "c", "-", "-o", str(library), "-ldl"],
        input=SOURCE,
        text=True,
        check=True,
    )
    return library
