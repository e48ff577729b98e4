"""Scene files that tests make without the package."""

import struct
from pathlib import Path

NAMES = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()


def write_ply(path: Path, rows) -> None:
    """Writes splats as a training of 3D Gaussian splatting does: rows of the numbers of NAMES."""
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n"
    head += "".join(f"property float {name}\n" for name in NAMES) + "end_header\n"
    path.write_bytes(head.encode() + b"".join(struct.pack("<14f", *row) for row in rows))
