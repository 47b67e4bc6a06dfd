"""Fail when CUDA packages were installed on a machine that has no NVIDIA GPU."""

import sys
from importlib import metadata
from pathlib import Path

GPU_DEVICES = (Path("/dev/nvidia0"), Path("/dev/dxg"))


def main() -> int:
    names = sorted({(d.metadata["Name"] or "").lower() for d in metadata.distributions()})
    cuda = [name for name in names if name.startswith("nvidia-")]
    if not cuda or any(device.exists() for device in GPU_DEVICES):
        return 0
    print(
        f"error: {len(cuda)} CUDA packages came in ({', '.join(cuda[:3])}, ...) but this machine has no NVIDIA GPU.\n"
        "       Take PyTorch's CPU build instead:\n"
        "         make distclean\n"
        '         make PIP_ARGS="--extra-index-url https://download.pytorch.org/whl/cpu" demo',
        file=sys.stderr,
    )
    return 1


if __name__ == "__main__":
    sys.exit(main())
