"""The native part of the package. Its classes are those of ``weather_magician``; see there for the conventions."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from weather_magician.aliases import CameraLike, Output, Path, Progress, Reading, WeatherLike

__version__: str
LIDAR_CLASSES: list[str]
"""Names of the classes of lidar points, by their number: surface, drop, flake, air, ghost."""

CONDITIONS: list[str]
"""Names of the conditions of clips, by their number: clear, fog, rain, snow, dust, night."""

class Error(Exception):
    """What went wrong, in one line: the file, field or value, and what to do.

    The text is that of the program.
    """

@final
class Splats:
    """The splats of a scene as read-only arrays, views without a copy. N splats, K coefficients."""

    def __len__(self) -> int: ...
    @property
    def means(self) -> NDArray[np.float32]:
        """Centres ``[N, 3]``, scene units."""
    @property
    def quats(self) -> NDArray[np.float32]:
        """Rotations ``[N, 4]``, wxyz; used at length 1."""
    @property
    def log_scales(self) -> NDArray[np.float32]:
        """Natural logarithms ``[N, 3]`` of the standard deviations, scene units."""
    @property
    def logit_opacities(self) -> NDArray[np.float32]:
        """Logits ``[N]`` of the opacities."""
    @property
    def sh(self) -> NDArray[np.float32]:
        """Spherical harmonics of the colour ``[N, K, 3]``; gsplat's ``colors`` with ``sh_degree``."""
    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0 to 3."""
    @property
    def labels(self) -> NDArray[np.uint16] | None:
        """Class of each splat ``[N]``, 0 for none; None if the scene has no labels."""
    def activated(self) -> dict[str, NDArray[np.float32]]:
        """Returns ``scales [N, 3]`` (scene units) and ``opacities [N]`` (0-1) as gsplat takes them: copies."""

@final
class Scene:
    """Splats, what is known of the place, and the cameras of its photos.

    Pickles hold the path and the SHA-256 of the file that it was read from, or else all splats.
    """

    @staticmethod
    def open(path: Path, *, repair: bool = False, level: int | None = None) -> Scene:
        """Reads a PLY, SPZ, SOG, glTF, .splat or .ksplat file, or the folder of a 3DGS training.

        ``repair`` leaves out splats that hold NaN. ``level`` is the level of detail where a scene has several; 0 is the finest.

        Raises :class:`Error` if there is no such file, or it is damaged.
        """
    @staticmethod
    def street(detail: float = 1.0) -> Scene:
        """Makes the built-in street, which needs no download. ``detail`` is 0.05 to 4: 1 has some 600,000 splats."""
    @staticmethod
    def from_arrays(
        means: ArrayLike,
        quats: ArrayLike,
        scales: ArrayLike,
        opacities: ArrayLike,
        sh: ArrayLike,
        *,
        labels: ArrayLike | None = None,
        metres_per_unit: float | None = None,
        up: ArrayLike | None = None,
        ground: float | None = None,
    ) -> Scene:
        """Makes a scene of arrays, as gsplat takes them.

        ``means [N, 3]`` (scene units), ``quats [N, 4]`` (wxyz), ``scales [N, 3]`` (scene units, above 0), ``opacities [N]`` (0-1),
        ``sh [N, K, 3]`` with K 1, 4, 9 or 16. ``up`` is the direction against gravity, ``ground`` the height of the ground along it (scene
        units); what is not given is estimated when the scene is loaded.

        Raises ``ValueError`` for arrays of another shape, :class:`Error` for numbers that cannot be drawn.
        """
    def __len__(self) -> int: ...
    @property
    def path(self) -> str | None:
        """The file that it was read from."""
    @property
    def splats(self) -> Splats:
        """The splats."""
    @property
    def origin(self) -> tuple[float, float, float]:
        """The point of the world that is zero in the scene, scene units; (0, 0, 0) unless its coordinates are far from zero.

        Splats, views, cameras and the height of the ground are relative to it: add it for coordinates of the world. Texts and files of cameras,
        and ``crop``, are in coordinates of the world.
        """
    @property
    def metres_per_unit(self) -> float | None:
        """The scale that the file states, metres a scene unit."""
    @property
    def up(self) -> tuple[float, float, float] | None:
        """The direction against gravity that the file states, length 1."""
    @property
    def ground(self) -> float | None:
        """The height of the ground along up that the file states, scene units."""
    @property
    def views(self) -> list[tuple[str, Camera]]:
        """The names and the cameras of its photos."""
    def with_facts(
        self, *, metres_per_unit: float | None = None, up: ArrayLike | None = None, ground: float | None = None
    ) -> Scene:
        """Returns the scene with facts of your own: metres a unit, the direction against gravity, the height of the ground along it."""
    def changed(
        self,
        *,
        crop: tuple[ArrayLike, ArrayLike] | None = None,
        up: ArrayLike | None = None,
        scale: float | Literal["metres"] | None = None,
        sh_degree: int | None = None,
        max_splats: int | None = None,
        device: str = "auto",
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> tuple[Scene, list[str]]:
        """Returns a changed scene, and lines that its user should know. Changes are made in this order:

        ``crop`` keeps the splats between two corners, ``up`` turns the scene so that its up becomes this direction, ``scale`` multiplies all
        lengths (``"metres"``: a unit becomes a metre), ``sh_degree`` leaves out higher degrees (0-3), ``max_splats`` keeps those that
        contribute most to views around the scene.
        """
    def save(self, path: Path) -> None:
        """Writes the scene in the format that ``path`` ends in, whole or not at all."""

@final
class Camera:
    """A pinhole camera."""

    def __new__(
        cls, viewmat: ArrayLike, K: ArrayLike, width: int, height: int, *, near: float = 0.2
    ) -> Camera:
        """A camera of ``viewmat [4, 4]`` (world to camera), ``K [3, 3]`` (px) and a size (px). Splats nearer than ``near`` (scene units) are not
        drawn.

        Raises :class:`Error` if the numbers make no camera.
        """
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...
    @staticmethod
    def look_at(
        eye: ArrayLike,
        target: ArrayLike,
        up: ArrayLike,
        *,
        fov: float = 50.0,
        size: tuple[int, int] | None = None,
        near: float = 0.2,
    ) -> Camera:
        """A camera at ``eye`` that looks at ``target`` (scene units); ``fov`` is vertical, degrees, ``size`` width and height, px (1280x720 by default)."""
    @property
    def viewmat(self) -> NDArray[np.float64]:
        """World to camera, ``[4, 4]``."""
    @property
    def K(self) -> NDArray[np.float64]:
        """Intrinsics ``[3, 3]``, px."""
    @property
    def width(self) -> int:
        """Width, px."""
    @property
    def height(self) -> int:
        """Height, px."""
    @property
    def near(self) -> float:
        """Near plane, scene units."""
    def resized(self, width: int, height: int) -> Camera:
        """Returns the camera with pictures of another size (px) and the same view."""

@final
class Weather:
    """Effects with their parameters over time, in physical units."""

    def __new__(cls, name: Path | None = None, parameters: Mapping[str, Any] | None = None) -> Weather:
        """Clear air, a preset (:meth:`presets`), a TOML file, a report (METAR, CARLA, hourly table) or words, with parameters changed::

            Weather("fog", {"fog.mor": 80})                       # visibility of 80 m
            Weather(parameters={"rain.rate": {0: 0, 5: 30}})      # mm/h, keyframes by seconds
            Weather("light snow, -3 C, wind 20 km/h")

        A value is a number in the parameter's unit, a text as on the command line, a colour (three numbers, sRGB, 0-1), or keyframes
        ``{seconds: value}``.

        Raises :class:`Error` with the nearest name if there is no such weather or parameter.
        """
    @staticmethod
    def presets() -> list[str]:
        """Returns the names of the presets."""
    @staticmethod
    def parse(text: str) -> Weather:
        """Reads the text of a weather file."""
    @staticmethod
    def from_report(
        report: Path,
        *,
        place: tuple[float, float] | None = None,
        day: int | None = None,
        seconds_per_hour: float = 1.0,
    ) -> Weather:
        """Reads a weather report or its file: METAR or SPECI, CARLA's parameters, an hourly table (Open-Meteo, Meteostat), a WMO code, or
        words.

        ``place`` is latitude and longitude, degrees; ``day`` the day of the year (1-366), for a METAR; an hour of a table takes
        ``seconds_per_hour`` of the shot. :attr:`notes` says what was guessed.
        """
    def set(self, key: str, value: Any) -> Weather:
        """Returns the weather with one parameter changed, such as ``set("fog.mor", 120)``, and its effect turned on."""
    def __eq__(self, other: object, /) -> bool: ...
    @property
    def name(self) -> str:
        """Its name."""
    @property
    def about(self) -> str:
        """A description in one line."""
    @property
    def notes(self) -> list[str]:
        """Guesses and what was left out, of a weather that was read from a report."""
    def parameters(self, time: float = 0.0) -> dict[str, Any]:
        """Returns the parameters of the effects that are on at a time (s), each in its unit."""
    def to_toml(self) -> str:
        """Returns the text of its file."""
    def save(self, path: Path) -> None:
        """Writes its file (TOML)."""

@final
class Picture:
    """A rendered picture. Notebooks show it.

    ``picture["depth"]`` is ``[H, W]``, ``picture["normal"]`` ``[H, W, 3]``: layers that were asked for with ``outputs``.
    """

    @property
    def width(self) -> int:
        """Width, px."""
    @property
    def height(self) -> int:
        """Height, px."""
    @property
    def camera(self) -> Camera:
        """The camera that took it."""
    @property
    def tags(self) -> list[tuple[str, str]]:
        """Names and values that are written into its files: the scene, the weather, the camera."""
    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour for display ``[H, W, 3]``, sRGB: the pixels of the PNG."""
    @property
    def rgb_linear(self) -> NDArray[np.float32]:
        """Colour in linear light ``[H, W, 3]``, 1 = display white."""
    def __getitem__(self, name: Output, /) -> NDArray[Any]: ...
    def save(self, path: Path, *, layers: bool = False) -> list[str]:
        """Writes the colour as .png, .exr or .npy and the other outputs beside it; returns a line for each of these.

        ``layers`` writes them as layers of the .exr.
        """

@final
class Renderer:
    """A device with a scene on it.

    Two renderers work side by side in two threads; calls of one renderer wait for each other.
    """

    def __new__(
        cls,
        scene: Scene | Path,
        *,
        device: str = "auto",
        threads: int | None = None,
        assets: Path | bool | None = None,
        memory: str | None = None,
        splats: int | None = None,
    ) -> Renderer:
        """Loads a scene: finds its up, its ground and its scale, and gives its splats to the device.

        ``device`` is ``auto`` (a hardware GPU if there is one, else the CPU), ``cpu``, ``gpu``, or ``gpu:NAME`` with a part of its name.
        ``threads`` is the number of threads, one per core by default. ``assets`` is the folder that keeps what takes long to find (beside the
        scene's file by default), False keeps nothing.

        The path of a scene in levels of detail that does not fit ``memory`` (such as ``"2GiB"``, the default) is drawn under that budget: each
        frame has a cut of the levels of its own, of at most ``splats`` splats; a video has one for all frames.

        Facts that are guessed are told as warnings of Python.
        """
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...
    @property
    def scene(self) -> Scene | None:
        """The scene; None if it is drawn in levels of detail."""
    def describe(self) -> str:
        """Returns the device in words."""
    @property
    def metres_per_unit(self) -> float:
        """Metres a scene unit."""
    @property
    def up(self) -> tuple[float, float, float]:
        """The direction against gravity, axes of the scene, length 1."""
    @property
    def ground(self) -> float:
        """The height of the ground along up, scene units."""
    def camera(
        self, camera: CameraLike | None = None, *, size: tuple[int, int] | None = None, fov: float | None = None
    ) -> Camera:
        """Returns a camera in the scene: that of a photo, one from eye to target, or by default one that suits the scene.

        ``size`` is width and height, px; ``fov`` is vertical, degrees.
        """
    def render(
        self,
        weather: WeatherLike,
        viewmats: ArrayLike,
        Ks: ArrayLike,
        width: int,
        height: int,
        *,
        time: ArrayLike | None = None,
        outputs: Sequence[Output] | None = None,
        near: float | None = None,
        velocities: ArrayLike | None = None,
        progress: Progress | None = None,
    ) -> dict[str, NDArray[Any]]:
        """Renders C cameras: arrays ``[C, H, W, k]`` by the names of ``outputs`` (``["rgb"]`` by default), which own their memory.

        ``viewmats [C, 4, 4]`` map the scene to the cameras (scene units), ``Ks [C, 3, 3]`` are in px. ``time`` is the instant of the weather, s:
        one for all, or ``[C]``; 0 by default. ``near`` is the near plane, scene units. ``velocities [C, 3]`` are those of the cameras, m/s, axes of the scene: rain is
        streaked by them.

        Raises ``ValueError`` for arrays of another shape, :class:`Error` for cameras that cannot be rendered.
        """
    def picture(
        self,
        weather: WeatherLike | None = None,
        camera: CameraLike | None = None,
        *,
        size: tuple[int, int] | None = None,
        fov: float | None = None,
        time: float = 0.0,
        outputs: Sequence[Output] | None = None,
        speed: float = 0.0,
    ) -> Picture:
        """Renders a picture, as the program's ``render`` does: saved as PNG it has the same bytes.

        ``time`` is the instant of the weather, s; ``speed`` that of the camera ahead, m/s. ``outputs`` are layers beside the colour.
        """
    def video(
        self,
        path: Path,
        weather: WeatherLike | None = None,
        camera: CameraLike | None = None,
        *,
        move: str | None = None,
        seconds: float = 5.0,
        fps: float = 30.0,
        size: tuple[int, int] | None = None,
        fov: float | None = None,
        speed: float | None = None,
        distance: float | None = None,
        progress: Progress | None = None,
    ) -> None:
        """Renders a video into the MP4 file ``path``.

        ``move`` is ``orbit``, ``dolly`` (``distance`` metres), ``capture`` (along the photos) or a JSON file of keyframes; ``speed`` is
        that of a camera that stays, m/s.
        """
    def scan(
        self,
        weather: WeatherLike | None = None,
        lidar: str = "os1-64",
        camera: CameraLike | None = None,
        *,
        time: float = 0.0,
        speed: float = 0.0,
        returns: Literal["strongest", "first", "last", "dual", "all"] = "strongest",
        rays: Literal[1, 7] = 7,
        frame: Literal["compensated", "raw", "world"] = "compensated",
        seed: int = 0,
        sweep: int = 0,
    ) -> dict[str, Any]:
        """Makes a sweep of a lidar that stands upright where a camera is and looks ahead as it does.

        ``lidar`` is a name (``weather-magician scan --help`` lists them) or a TOML file. Returns, for N points: ``position [N, 3]`` (m, in
        axes of the sensor x ahead, y left, z up; with ``frame="world"`` those of the scene in metres), ``range [N]`` (m),
        ``intensity [N]`` (0-255), ``time [N]`` (s after the start), ``ring``, ``column``, ``class`` (:data:`LIDAR_CLASSES`) and
        ``label [N]``, ``world_from_sensor [4, 4]`` (m) and the number of ``pulses``.
        """
    def bake(
        self, weather: WeatherLike, *, time: float = 0.0, progress: Progress | None = None
    ) -> Scene:
        """Returns the scene with the snow, the dust and the light of an instant of a weather as splats, for any renderer.

        Raises :class:`Error` if nothing lies.
        """
    def measure(
        self,
        weather: WeatherLike,
        *,
        time: float = 0.0,
        camera: CameraLike | None = None,
        instruments: Sequence[str] | None = None,
        size: tuple[int, int] | None = None,
        progress: Progress | None = None,
    ) -> list[Reading]:
        """Measures the weather in rendered pictures and compares it with its parameters: visibility, rain rate, snow depth and others.

        ``instruments`` are their names (``weather-magician measure --help``), by default all that apply; ``size`` is that of the pictures of the
        scene, px (480x320 by default).
        """

@final
class Batch:
    """A data set by a plan (TOML), made block for block: ``docs/guide/batch.md``. Any process can make any block."""

    def __new__(
        cls, plan: Path, out: Path | None = None, *, device: str = "auto", threads: int | None = None
    ) -> Batch:
        """Opens a plan. ``out`` is the folder of the set, named after the plan by default.

        Raises :class:`Error` with line and key of what is wrong in the plan.
        """
    @property
    def plan(self) -> str:
        """The path of the plan."""
    @property
    def out(self) -> str:
        """The folder of the set."""
    @property
    def name(self) -> str:
        """The name of the set."""
    @property
    def digest(self) -> str:
        """The hash of the plan and all that it names."""
    @property
    def clips(self) -> int:
        """Number of clips."""
    @property
    def frames(self) -> int:
        """Number of frames."""
    @property
    def blocks(self) -> int:
        """Number of blocks."""
    def shard(self, index: int, count: int) -> range:
        """Returns the blocks of part ``index`` (from 0) of ``count``."""
    def block(self, number: int) -> dict[str, Any]:
        """Returns the ``scene`` (name) and the ``frames`` (first and end) of a block."""
    def missing(self) -> list[int]:
        """Returns the blocks that are not marked as done."""
    def marker(self, number: int) -> dict[str, Any] | None:
        """Returns the marker of a block that is done: its clips, and its files with lengths and SHA-256."""
    def make(self, block: int, progress: Progress | None = None) -> None:
        """Makes a block and marks it as done. Nothing of it is left if it is stopped."""
    def make_shard(self, index: int, count: int, progress: Progress | None = None) -> list[int]:
        """Makes the blocks of a part that are not done, and returns their numbers."""
    def merge(self, verify: bool = False) -> dict[str, Any]:
        """Checks that all blocks are there and writes the tables of the layouts, the manifest and the summary.

        ``verify`` compares the hashes of all files too. Returns the numbers of ``clips``, ``frames``, ``readings`` and ``bytes``, and
        ``warnings``.
        """
    @property
    def splits(self) -> list[str]:
        """The names of the splits."""
    def split(self, name: str) -> SplitFrames:
        """Returns the frames of a split, without a list of them in memory."""
    @property
    def sensors(self) -> list[str]:
        """The names of the sensors of the rig."""
    @property
    def frames_per_clip(self) -> int:
        """Number of frames of a clip."""
    def sample(
        self, frame: int, sensor: str | None = None, layers: Sequence[str] | None = None, *, places: int = 2
    ) -> dict[str, Any]:
        """Renders one reading of a frame in memory: the values that the files of the set have, in any order of frames.

        ``sensor`` is the first camera by default. ``layers`` are those of the plan by default, else ``rgb`` (uint8), ``clear`` (the same without weather),
        and the outputs of :meth:`Renderer.render`, ``flow`` and ``motion`` beside them; arrays are ``[H, W]`` or ``[H, W, k]``. A lidar gives ``points [N, 4]``
        (m, intensity 0-255), ``range``, ``point_time``, ``angles``, ``ring``, ``label``, ``rank`` and ``class``; a radar ``detections [N, 7]``.
        Beside them are ``K [3, 3]`` (px), ``viewmat [4, 4]`` (OpenCV axes, metres), ``world_from_rig`` and ``world_from_sensor``, ``time`` (s),
        ``condition`` (one of :data:`CONDITIONS`), ``weather`` (``mor`` m, ``rain_rate`` and ``snow_rate`` mm/h, ``is_night``, ``variables``), ``clip``,
        ``split``, ``place`` and ``weather_file``.

        ``places`` scenes stay open. Raises ``IndexError`` beyond the last frame.
        """
    def take_warnings(self) -> list[str]:
        """Returns the warnings since the last call."""

@final
class SplitFrames:
    """The frames of one split of a set, in their order: a sequence of numbers that takes no memory."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> int: ...

@final
class Permutation:
    """The numbers below ``count`` in a random order that takes no memory. ``stream`` numbers the orders of one seed."""

    def __new__(cls, count: int, seed: int = 0, stream: int = 0) -> Permutation: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> int: ...

def reconstruct(
    photos: Path,
    *,
    preset: Literal["draft", "quick", "standard", "best"] = "standard",
    steps: int | None = None,
    max_splats: int | None = None,
    eval_every: int = 0,
    run_folder: Path | None = None,
    resume: Literal["never", "always", "overwrite"] = "never",
    metres_per_unit: float | None = None,
    camera_height: float | None = None,
    device: str = "auto",
    threads: int | None = None,
    callback: Callable[[str, dict[str, Any]], object] | None = None,
) -> Scene:
    """Turns photos into a scene.

    ``photos`` is a folder with a COLMAP model, a ``transforms.json`` or another capture, or of photos alone where COLMAP is installed.
    ``eval_every`` holds out every N-th photo and scores it; ``run_folder`` keeps checkpoints, and ``resume="always"`` continues
    there. ``camera_height`` is that of the cameras over the ground, m, and gives the scale.

    ``callback(event, facts)`` is called with ``step`` (step, steps, splats, loss), ``summary``, ``evaluation`` (psnr in dB, ssim),
    ``checkpoint`` (path, step), ``notice`` and ``warning`` (text), and ``finish``. An exception in it stops the training, after a
    checkpoint was written.

    Raises :class:`Error` if the photos cannot be used.
    """

def run_program(args: Sequence[str]) -> int:
    """Runs the program with these arguments, of which the first is its name, and returns its exit status."""

# What pickles call.
def _scene_of_file(
    path: Path,
    repair: bool,
    level: int | None,
    digest: str,
    facts: tuple[float | None, tuple[float, float, float] | None, float | None],
) -> Scene: ...
def _scene_of_bytes(bytes: bytes, views: list[tuple[str, Camera]]) -> Scene: ...
def _weather_of(text: str, notes: list[str]) -> Weather: ...
def _open_batch(plan: Path, out: Path, device: str, threads: int | None, digest: str) -> Batch: ...
