"""Settles what JAX and MuJoCo read from the environment, before they start, and says what they run
on.

What lives here: devices, XLA flags, caches, known-bad versions, the banner. What does not: which of
the user's variables JAX keeps (`jax_variables`), which OpenGL draws (`rendering`), checks of a
whole machine (`cli.doctor`). Nothing at module level imports JAX or MuJoCo: both read the
environment once, while they are imported.
"""

import contextlib
import hashlib
import io
import os
import platform
import sys
import warnings
from collections.abc import Callable
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from dronecombat_jax.config import estimates
from dronecombat_jax.errors import UserError
from dronecombat_jax.machine import jax_variables, rendering

BAD_JAX = {
    "0.10.0": "it can hang for ever on two CPU cores, asleep in its first calls",
    "0.10.1": "it can hang for ever on two CPU cores, asleep in its first calls",
    "0.10.2": "silently wrong vmapped matrix-vector products on a CPU (jax#39103)",
    "0.11.0": "a scan's outputs take quadratic time on a CPU, and NaN on some GPUs",
    "0.11.1": "a scan's outputs take quadratic time on a CPU, and NaN on some GPUs",
}
GOOD_JAX = "'jax==0.12.0.1' 'jaxlib==0.12.0.1'"  # for pip, as in constraints.txt
GOOD_JAX_3_11 = "'jax==0.9.2' 'jaxlib==0.9.2' 'flax==0.12.6'"  # later ones of flax need a later jax
DEADLOCK_FLAG = "--xla_cpu_enable_concurrency_optimized_scheduler"
# XLA ends a process whose devices have waited 40 s for each other, as on a machine that many
# processes share.
MEETING_FLAG, MEETING_SECONDS = "--xla_cpu_collective_call_terminate_timeout_seconds", "3600"
VECTOR_FLAG = "--xla_cpu_prefer_vector_width"
TRIED_RELEASES = ((0, 9), (0, 13))  # from, before: XLA dies of a flag that it does not know
DEVICE_VARIABLES = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME", "JAX_DEFAULT_DEVICE")
PLUGINS = {
    "gpu": ("jax_cuda13_plugin", "jax_cuda12_plugin", "jax_rocm7_plugin"),
    "tpu": ("libtpu",),
}

_set_by_us: dict[str, str] = {}


def prepare(
    device: str = "auto", cpu_devices: int = 1, join: Callable[[], None] = lambda: None
) -> None:
    """Set up JAX and MuJoCo for `device`: auto, cpu, gpu or tpu. Call it before either is imported.

    `cpu_devices`: how many devices a CPU shall pretend to be; seeds trained on several never wait
    for each other. `join`: meets other processes (`processes.join`), which must come before JAX
    looks at its devices. Where the user has set a variable, it stays, but for those in
    `jax_variables.FIXED`; only a `device` asked for by name wins over JAX_PLATFORMS. Raises
    UserError (exit 2) for a known-bad jax, for a device that is not there and for variables with
    which JAX does not start.
    """
    refuse_bad_jax()
    platforms = _platforms(device)
    jax_variables.fix()
    _prepare_xla(device)
    if cpu_devices > 1 and device not in PLUGINS:
        _set_flag("--xla_force_host_platform_device_count", str(cpu_devices))
        if TRIED_RELEASES[0] <= _release() < TRIED_RELEASES[1]:
            _set_flag(MEETING_FLAG, MEETING_SECONDS)
    _prepare_jax(platforms)
    if chosen := rendering.settle():
        _set_by_us["MUJOCO_GL"] = chosen
    join()
    if device in PLUGINS:
        _require_devices(device)
    elif jax_variables.set_by_user(_set_by_us):
        require_start()


def require_start() -> None:
    """Raise UserError (exit 2) where JAX does not start; it names what the user has set."""
    jax_variables.require_start(_set_by_us)


def set_matmul_precision(precision: str) -> None:
    """Set the precision of float32 matrix products; call it before `prepare`.

    `precision` is one of JAX's names. A precision that the user has set in the environment stays.
    It makes a difference on a GPU (Ampere and later: TensorFloat-32) and on a TPU (bfloat16).
    """
    if precision != "default" and "JAX_DEFAULT_MATMUL_PRECISION" not in os.environ:
        _set("JAX_DEFAULT_MATMUL_PRECISION", precision)


def refuse_bad_jax() -> None:
    """Raise UserError (exit 2) for the versions of jax that hang, compute wrong numbers or crawl."""
    version = metadata.version("jax")
    if version in BAD_JAX:
        good = GOOD_JAX_3_11 if sys.version_info < (3, 12) else GOOD_JAX
        raise UserError(
            f"jax {version} cannot be used: {BAD_JAX[version]}. Fix: pip install {good}"
        )


def import_mjx():
    """The module `mujoco.mjx`, imported without its greeting: stdout belongs to the commands."""
    with contextlib.redirect_stdout(io.StringIO()) as greeting:
        from mujoco import mjx
    for line in greeting.getvalue().splitlines():
        if not line.startswith("Failed to import"):  # warp, which MJX can use and we do not
            print(line, file=sys.stderr)
    return mjx


def banner() -> list[str]:
    """Lines that name machine, devices, versions and what `prepare` set. Starts JAX."""
    import jax

    names = [f"{device.platform}:{device.id} ({device.device_kind})" for device in jax.devices()]
    packages = ("jax", "jaxlib", "mujoco", "mujoco-mjx")
    versions = [
        f"python {platform.python_version()}",
        *(f"{name} {metadata.version(name)}" for name in packages),
    ]
    ours = [f"{name}={value}" for name, value in _set_by_us.items()]
    return [
        f"machine   {machine()}",
        f"devices   {', '.join(names)}",
        f"versions  {', '.join(versions)}",
        f"set by us {', '.join(ours) or 'nothing'}",
    ]


def machine() -> str:
    """Processor, cores that this process may use, and memory, in words."""
    memory = estimates.machine_bytes()
    size = f"{memory / 2**30:.1f} GiB of memory" if memory else "unknown memory"
    return f"{_cpu()[0]}, {cores()} cores, {size}"


def cache_dir() -> Path:
    """Folder of compiled programs: $DRONECOMBAT_CACHE, else `dronecombat` in the user's cache
    folder.
    """
    if chosen := os.environ.get("DRONECOMBAT_CACHE"):
        return Path(chosen).expanduser().absolute()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dronecombat"


def _platforms(device: str) -> str | None:
    """The value of JAX_PLATFORMS for `device`; None to leave it alone."""
    if device not in PLUGINS:
        return "cpu" if device == "cpu" else None
    plugins = [name for name in PLUGINS[device] if find_spec(name)]
    if not plugins:
        extra = "cuda12" if device == "gpu" else "tpu"
        raise UserError(
            f"device {device}: this JAX cannot drive one (no {' or '.join(PLUGINS[device])}). "
            f"Fix: pip install 'jax[{extra}]=={metadata.version('jax')}', or --run.device cpu"
        )
    kind = "tpu" if device == "tpu" else "rocm" if "rocm" in plugins[0] else "cuda"
    return f"{kind},cpu"


def _prepare_xla(device: str) -> None:
    """Set XLA's flags: the CPU's widest vectors, and before jax 0.11 the scheduler that cannot
    deadlock on two cores and a log without false alarms.
    """
    release = _release()
    if device in PLUGINS:
        return
    if TRIED_RELEASES[0] <= release < TRIED_RELEASES[1] and "avx512f" in _cpu()[1].split():
        # XLA itself stays at 256: learning takes 4 to 7 % longer (docs/tuning.md)
        _set_flag(VECTOR_FLAG, "512")
    if release >= (0, 11):
        return
    if DEADLOCK_FLAG not in os.environ.get("XLA_FLAGS", ""):
        if "jax" in sys.modules:
            warnings.warn(
                "JAX was imported before prepare(): if it has computed already, it may hang",
                stacklevel=3,
            )
        _set_flag(DEADLOCK_FLAG, "false")
    # Every program from the cache logs a page of errors about tuning flags that are no CPU
    # features.
    if "TF_CPP_MIN_LOG_LEVEL" not in os.environ:
        _set("TF_CPP_MIN_LOG_LEVEL", "3")


def _release() -> tuple[int, ...]:
    """The release of jax as numbers, such as (0, 12)."""
    return tuple(int(part) for part in metadata.version("jax").split(".")[:2])


def _set_flag(name: str, value: str) -> None:
    """Add a flag of XLA, unless the user has set it."""
    flags = os.environ.get("XLA_FLAGS", "")
    if name in flags:
        return
    os.environ["XLA_FLAGS"] = f"{flags} {name}={value}".strip()
    _set_by_us["XLA_FLAGS"] = f"{_set_by_us.get('XLA_FLAGS', '')} {name}={value}".strip()


def cores() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS
        return os.cpu_count() or 1


def _prepare_jax(platforms: str | None) -> None:
    """Set JAX's platforms, and its persistent cache for every compiled program."""
    chosen: dict[str, str | float | int] = {}
    if platforms:
        for name in DEVICE_VARIABLES:
            os.environ.pop(name, None)
        chosen["jax_platforms"] = platforms
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        folder = cache_dir() / "xla" / _fingerprint()
        if _writable(folder):
            chosen["jax_compilation_cache_dir"] = str(folder)
            chosen["jax_persistent_cache_min_compile_time_secs"] = 0.0
            chosen["jax_persistent_cache_min_entry_size_bytes"] = 0
        else:
            _set_by_us["JAX_COMPILATION_CACHE_DIR"] = f"(no cache: cannot write {folder})"
    for name, value in chosen.items():
        if name.upper() in os.environ:
            continue
        _set(name.upper(), str(value))
        if "jax" in sys.modules:  # it has read the environment already
            sys.modules["jax"].config.update(name, value)


def _require_devices(device: str) -> None:
    import jax

    try:
        jax.devices(device)
    except RuntimeError as error:
        reason = " ".join(str(error).split())[:160]
        raise UserError(f"device {device}: there is none on this machine ({reason})") from None


def _set(variable: str, value: str) -> None:
    os.environ[variable] = _set_by_us[variable] = value


def _fingerprint() -> str:
    """Version and processor: a program compiled for another processor may die of an illegal
    instruction.
    """
    digest = hashlib.sha256("\n".join(_cpu()).encode()).hexdigest()[:12]
    return f"jax-{metadata.version('jaxlib')}-{digest}"


def _cpu() -> tuple[str, str]:
    """Model and feature flags of the processor, as Linux tells them."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    entries = {
        key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)
    }
    return entries.get("model name") or platform.machine(), entries.get("flags") or entries.get(
        "Features", ""
    )


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)
