"""The process's GPU, by wgpu: Vulkan, Metal or Direct3D 12."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import RendererUnavailableError
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.render.structure import BLUR_TAPS, MODEL_NOISE

ADAPTER_VARIABLE = "POSEVIEWER_ADAPTER"
"""Environment variable whose value ``software`` allows the processor as adapter, for tests."""
ADAPTER_KINDS = ("DiscreteGPU", "IntegratedGPU", "VirtualGPU", "Unknown", "CPU")
"""Kinds of adapters, the best first."""
BACKENDS = ("Vulkan", "Metal", "DX12")
"""Backends with compute shaders; OpenGL lacks them on some machines."""
GPU_ADVICE = 'use `renderer="software"`, or "auto"'
"""End of messages where the GPU cannot be used."""
WORKGROUP_FACES = 64
"""Faces that a workgroup draws, as in ``moments.wgsl``."""
GROUPS = 16
"""Workgroups that share the sums over a pose's pixels: each sums few enough for float32."""
ENTRY_POINTS = ("draw", "shade", "blur")
"""Entry points of ``moments.wgsl``."""
RECORD_SIZE = 221
"""Numbers that a workgroup writes, as in ``moments.wgsl``."""
BINDINGS = 11
"""Number of bindings: the parameters, those that are read, and those from ``FIRST_WRITTEN`` on."""
FIRST_WRITTEN = 7
"""Number of the first binding that the shader writes to."""
_device_lock = threading.Lock()


@lru_cache(maxsize=2)
def _device(software: bool) -> Device:
    return Device(find_adapter(software))


def gpu_device() -> Device:
    """Return the process's device, made once.

    Raises:
        RendererUnavailableError: there is no GPU.
    """
    with _device_lock:
        return _device(os.environ.get(ADAPTER_VARIABLE) == "software")


def find_adapter(software: bool) -> Any:
    """Find the best adapter; ``software`` allows the processor itself."""
    # Mesa's device selection looks for a display, and warns if there is none.
    os.environ.setdefault("NODEVICE_SELECT", "1")
    try:
        import wgpu
        from wgpu.backends.wgpu_native.extras import set_instance_extras
    except ImportError as error:
        raise RendererUnavailableError(
            f"The package wgpu is not installed; pip install 'poseviewer[gpu]', or {GPU_ADVICE}."
        ) from error
    with suppress(RuntimeError):  # the program that imports poseviewer may have set up wgpu
        # OpenGL is not initialised: a process has one context, which ``render.opengl`` needs.
        set_instance_extras(backends=list(BACKENDS))
    every = wgpu.gpu.enumerate_adapters_sync()
    adapters = [adapter for adapter in every if adapter.info["backend_type"] in BACKENDS]
    if not adapters:
        raise RendererUnavailableError(
            "No GPU here (Vulkan, Metal and Direct3D 12 tried); install the GPU's driver, or "
            f"{GPU_ADVICE}."
        )
    best = min(adapters, key=lambda adapter: ADAPTER_KINDS.index(adapter.info["adapter_type"]))
    if best.info["adapter_type"] == "CPU" and not software:
        raise RendererUnavailableError(
            f"The only adapter here, {best.info['device']}, is the processor itself, on which the "
            f"software renderer is much faster; {GPU_ADVICE}."
        )
    return best


class Device:
    """A device with the compiled shader and buffers that batches share; safe for threads."""

    def __init__(self, adapter: Any) -> None:
        """Compile the shader.

        Raises:
            RendererUnavailableError: the adapter cannot run it.
        """
        import wgpu

        self.name: str = adapter.info["device"]
        self.is_software: bool = adapter.info["adapter_type"] == "CPU"
        self.lost = False
        """Whether the device has failed; it is then not used again."""
        self.errors: tuple[type[Exception], ...] = (wgpu.GPUError, RuntimeError, MemoryError)
        """Errors of a device that is lost, or whose memory is full."""
        names = "storage-buffer-binding-size", "buffer-size", "storage-buffers-per-shader-stage"
        limits = {f"max-{name}": adapter.limits[f"max-{name}"] for name in names}
        try:
            self._device = adapter.request_device_sync(required_limits=limits)
            self._layout, self._pipelines = _compile_shader(self._device)
        except (wgpu.GPUError, wgpu.GPUPipelineError, RuntimeError) as error:
            raise RendererUnavailableError(
                f"The GPU {self.name} cannot run the shader ({str(error)[:200]}); {GPU_ADVICE}."
            ) from error
        self._lock = threading.Lock()
        self._work: dict[str, Any] = {}
        self._photos: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()

    def upload(self, data: NDArray[Any]) -> Any:
        """Make a buffer of ``data`` with 32-bit numbers."""
        data = data if data.size else np.zeros(4, data.dtype)
        usage = self._usage("STORAGE")
        return self._device.create_buffer_with_data(data=np.ascontiguousarray(data), usage=usage)

    def photo(self, photo: Any, pixels: Callable[[], NDArray[np.float32]]) -> Any:
        """Return the buffer of a photo's ``pixels``, which lives as long as the photo."""
        with self._lock:
            if photo not in self._photos:
                self._photos[photo] = self.upload(pixels())
            return self._photos[photo]

    def sums(
        self,
        parameters: tuple[int, int, int, bool],
        inputs: tuple[Any, ...],
        poses: NDArray[Any],
        pixels: int,
    ) -> NDArray[np.float32]:
        """Compute the sums of many poses, see ``moments.wgsl``.

        Args:
            parameters: numbers of faces and texture levels, width of the photo in px, and whether
                edges are compared.
            inputs: buffers of vertices, faces, texels, table and photo.
            poses: (poses,) of the shader's ``Pose``.
            pixels: number of pixels in all boxes.

        Returns:
            (poses, ``GROUPS``, ``RECORD_SIZE``): the record of each workgroup.
        """
        faces, _, _, has_edges = parameters
        size = 4 * GROUPS * RECORD_SIZE * len(poses)
        with self._lock:
            of_poses = self._buffer("poses", poses.nbytes)
            self._device.queue.write_buffer(of_poses, 0, poses)
            depths, ids = (self._buffer(name, 4 * pixels) for name in ("depths", "ids"))
            field = self._buffer("field", 8 * pixels if has_edges else 8)
            sums = self._buffer("sums", size)
            buffers = of_poses, *inputs, depths, ids, field, sums
            first, second = (self._group((phase, *parameters), buffers) for phase in (0, 1))
            encoder = self._device.create_command_encoder()
            for cleared in (depths, ids, *([field] if has_edges else [])):
                encoder.clear_buffer(cleared)
            drawing = -(-faces // WORKGROUP_FACES), len(poses)
            self._dispatch(encoder, "draw", first, drawing)
            self._dispatch(encoder, "draw", second, drawing)
            self._dispatch(encoder, "shade", second, (GROUPS, len(poses)))
            if has_edges:
                self._dispatch(encoder, "blur", second, (GROUPS, len(poses)))
            self._device.queue.submit([encoder.finish()])
            records = np.frombuffer(self._device.queue.read_buffer(sums, 0, size), np.float32)
        return records.reshape(len(poses), GROUPS, RECORD_SIZE)

    def _dispatch(self, encoder: Any, entry: str, group: Any, counts: tuple[int, int]) -> None:
        work = encoder.begin_compute_pass()
        work.set_pipeline(self._pipelines[entry])
        work.set_bind_group(0, group)
        work.dispatch_workgroups(*counts)
        work.end()

    def _group(self, parameters: tuple[int, ...], buffers: tuple[Any, ...]) -> Any:
        numbers = np.array([*parameters, 0, 0, 0], np.uint32)
        uniform = self._device.create_buffer_with_data(data=numbers, usage=self._usage("UNIFORM"))
        entries = [
            {"binding": k, "resource": {"buffer": buffer, "offset": 0, "size": buffer.size}}
            for k, buffer in enumerate((uniform, *buffers))
        ]
        return self._device.create_bind_group(layout=self._layout, entries=entries)

    def _buffer(self, name: str, size: int) -> Any:
        """Return the buffer of this name, replaced if it is too small."""
        buffer = self._work.get(name)
        if buffer is None or buffer.size < size:
            room = 1 << max(int(size) - 1, 255).bit_length()
            buffer = self._device.create_buffer(size=room, usage=self._usage("STORAGE"))
            self._work[name] = buffer
        return buffer

    def _usage(self, kind: str) -> int:
        from wgpu import BufferUsage

        return getattr(BufferUsage, kind) | BufferUsage.COPY_DST | BufferUsage.COPY_SRC


def _compile_shader(device: Any) -> tuple[Any, dict[str, Any]]:
    """Layout of bind groups, and pipelines by their entry points."""
    from wgpu import ShaderStage

    read, written = FIRST_WRITTEN - 1, BINDINGS - FIRST_WRITTEN
    kinds = ["uniform", *["read-only-storage"] * read, *["storage"] * written]
    entries = [
        {"binding": k, "visibility": ShaderStage.COMPUTE, "buffer": {"type": kind}}
        for k, kind in enumerate(kinds)
    ]
    group = device.create_bind_group_layout(entries=entries)
    layout = device.create_pipeline_layout(bind_group_layouts=[group])
    source = (Path(__file__).parent / "moments.wgsl").read_text()
    constants = {"grey": GREY_WEIGHTS, "taps": BLUR_TAPS, "noise": [64.0 * MODEL_NOISE**2]}
    for name, numbers in constants.items():
        source = source.replace(f"{{{name}}}", ", ".join(repr(float(x)) for x in numbers))
    module, pipelines = device.create_shader_module(code=source), {}
    for entry in ENTRY_POINTS:
        compute = {"module": module, "entry_point": entry}
        pipelines[entry] = device.create_compute_pipeline(layout=layout, compute=compute)
    return group, pipelines
