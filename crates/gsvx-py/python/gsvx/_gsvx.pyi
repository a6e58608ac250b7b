"""The compiled part. Use the package's own functions, which check arguments and document them."""

from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, final

import numpy as np
import numpy.typing as npt

__all__ = [
    "DEFAULT_QUALITY",
    "Error",
    "FrameReader",
    "PRESETS",
    "Reader",
    "__version__",
    "compare",
    "compress",
    "decompress",
    "orbit",
    "read_cameras",
    "read_model",
    "render",
    "set_threads",
    "tune",
    "write_model",
]

__version__: str
DEFAULT_QUALITY: float
PRESETS: Dict[str, float]

_Arrays = Dict[str, Any]
_Tell = Optional[Callable[..., Any]]

class Error(Exception):
    """A model, a stream, cameras or photos that cannot be used; the message says why."""

@final
class Reader:
    def __new__(cls, name: str, max_gaussians: Optional[int]) -> Reader: ...
    def head_needs(self) -> Optional[Tuple[int, int]]: ...
    def give(self, offset: int, data: bytes) -> None: ...
    def needs(self, chunk: int, layers: int) -> List[Tuple[int, int]]: ...
    def forget(self, chunk: int) -> None: ...
    def decode(self, chunk: int, layers: int) -> _Arrays: ...
    def head(self) -> Optional[Dict[str, Any]]: ...

@final
class FrameReader:
    def __new__(cls, data: bytes, name: str, max_gaussians: Optional[int]) -> FrameReader: ...
    @property
    def fps(self) -> float: ...
    @property
    def groups(self) -> List[Tuple[int, int]]: ...
    def frame(self, number: int) -> _Arrays: ...

def set_threads(threads: int) -> None:
    """Sets the number of threads of all later calls; 0 for one per core."""

def read_cameras(path: str) -> Dict[str, Any]: ...
def orbit(splats: Dict[str, Any], orbit: Dict[str, Any]) -> Dict[str, Any]: ...
def decompress(
    stream: bytes, name: str, wanted: Dict[str, Any]
) -> Tuple[_Arrays, List[str]]: ...
def compress(
    splats: Dict[str, Any],
    options: Dict[str, Any],
    cameras: Optional[Dict[str, Any]],
    progress: _Tell,
) -> Tuple[bytes, Dict[str, Any]]: ...
def read_model(
    path: str, drop_invalid: bool, keep_axes: bool
) -> Tuple[_Arrays, List[str]]: ...
def write_model(path: str, splats: Dict[str, Any]) -> bool: ...
def compare(
    reference: Dict[str, Any], model: Dict[str, Any], cameras: Dict[str, Any], progress: _Tell
) -> List[Tuple[float, float, float]]: ...
def render(
    splats: Dict[str, Any], cameras: Dict[str, Any], background: Sequence[float], progress: _Tell
) -> List[npt.NDArray[np.float32]]: ...
def tune(
    splats: Dict[str, Any],
    cameras: Dict[str, Any],
    photos: Optional[Sequence[Any]],
    options: Dict[str, Any],
    made: Callable[[bytes, Dict[str, Any]], None],
    progress: _Tell,
) -> None: ...
