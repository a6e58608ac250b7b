"""gsvx compresses trained 3D Gaussian splatting scenes.

>>> import gsvx
>>> splats = gsvx.read_model("point_cloud.ply")     # or the dict of your trainer
>>> report = gsvx.compress("scene.gsvx", splats, quality=60)
>>> splats = gsvx.decompress("scene.gsvx")

Splats are dicts of arrays with gsplat's names; :func:`compress` describes them. Results depend neither on the
number of threads nor on the machine. Long work releases the GIL and ends with Ctrl-C.
"""

from ._arrays import Splats
from ._cameras import Cameras, read_cameras
from ._codec import PRESETS, compress, compress_to_bytes, decompress, decompress_bytes
from ._files import read_model, write_model
from ._frames import Frames, frames
from ._gsplat import GsvxCompression
from ._gsvx import DEFAULT_QUALITY, Error, __version__, set_threads
from ._render import compare, orbit, render
from ._reports import Comparison, Estimate, Progress, Report, TuneReport, ViewScore
from ._stream import Chunk, Stream, open
from ._tune import tune
from ._usd import from_usd, to_usd

__all__ = [
    "Cameras",
    "Chunk",
    "Comparison",
    "DEFAULT_QUALITY",
    "Error",
    "Estimate",
    "Frames",
    "GsvxCompression",
    "PRESETS",
    "Progress",
    "Report",
    "Splats",
    "Stream",
    "TuneReport",
    "ViewScore",
    "__version__",
    "compare",
    "compress",
    "compress_to_bytes",
    "decompress",
    "decompress_bytes",
    "frames",
    "from_usd",
    "open",
    "orbit",
    "read_cameras",
    "read_model",
    "render",
    "set_threads",
    "to_usd",
    "tune",
    "write_model",
]
