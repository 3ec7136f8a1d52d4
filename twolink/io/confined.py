"""Files that other files name, such as meshes, materials and pictures: opened only inside a folder.

A URDF or a mesh may come from a stranger. Whatever a name in it looks like, the file is judged where it is opened.
"""

import errno
import os
import stat
from pathlib import Path


def read_confined(root: Path, name: str | Path, limit: int) -> bytes:
    """The content of a regular file in a folder.

    Parameters
    ----------
    root : Path
        The folder that the file must lie in, after all symbolic links.
    name : str or Path
        The file, relative to `root`, or an absolute path.
    limit : int
        The largest size, bytes.

    Raises
    ------
    OSError
        The file is missing, outside, too large, or no regular file (a device or a pipe may have no end).
    """
    try:
        path = (root / name).resolve()
        is_inside = path.is_relative_to(root.resolve())
    except (ValueError, RuntimeError):  # a NUL in the name, a loop of links
        raise OSError(errno.EINVAL, "not the name of a file", str(name)) from None
    if not is_inside:
        raise OSError(errno.EACCES, f"outside {root}", str(name))
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(name))
        content = file.read(limit + 1)
    if len(content) > limit:
        raise OSError(errno.EFBIG, f"larger than {limit} bytes", str(name))
    return content
