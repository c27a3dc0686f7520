"""Kernels: PTX that Warp compiled becomes a library of the host, of which a launch calls one function per thread."""

from __future__ import annotations

import ctypes
import dataclasses
import json
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from tests.emulated_cuda.counts.launch_counts import FlowTables
from tests.emulated_cuda.device import Device
from tests.emulated_cuda.native import native_library
from tests.emulated_cuda.ptx.ptx_function import c_name
from tests.emulated_cuda.ptx.ptx_module import KernelFacts, PtxModule
from tests.emulated_cuda.settings import Check

SHARED_MEMORY = 232448
"""Bytes of shared memory that a block may have."""
ARGUMENT_BYTES = 32764
"""Bytes of arguments that a kernel may have."""
BLOCK_THREADS = 1024
WARP = 32
LONG = 3000
"""Lines of PTX above which it is compiled without optimisation."""
TRANSLATOR = (
    *sorted((native_library.HERE.parent / "ptx").glob("*.py")),
    native_library.HERE / "device_runtime.h",
)
"""Files of which the translation is made."""
FLAGS = (
    "-w", "-ffp-contract=off", "-fno-strict-aliasing", "-fwrapv", "-fno-math-errno", "-frounding-math",
    "-U_FORTIFY_SOURCE", "-shared", "-fPIC",
)  # fmt: skip
CHECK_FLAGS = {
    Check.OFF: (),
    Check.MEMORY: ("-DEMU_CHECK",),
    Check.RACE: ("-DEMU_CHECK", "-DEMU_RACE"),
    Check.COUNT: ("-DEMU_COUNT",),
}


@dataclass
class Module:
    """A translated PTX module; `handles` are those of its kernels, by name."""

    library: ctypes.CDLL
    kernels: dict[str, KernelFacts]
    shared_size: int
    handles: dict[str, int]
    flow: FlowTables


@dataclass(frozen=True)
class Kernel:
    """A kernel that can be launched."""

    name: str
    address: int
    facts: KernelFacts
    shared_size: int
    flow: FlowTables


class KernelModules:
    """Modules and kernels of the device, by handle.

    Args:
        device: of the kernels.
        check: what they are translated for; by default what the device checks.
    """

    def __init__(self, device: Device, check: Check | None = None) -> None:
        self.device = device
        self.check = check or device.settings.check
        self.modules: dict[int, Module] = {}
        self.kernels: dict[int, Kernel] = {}

    def load(self, ptx: str) -> int:
        """Translate and load PTX; the module's handle."""
        path = self._library(ptx)
        library = ctypes.PyDLL(str(path))
        library.emu_module_init()
        found = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        kernels = {name: KernelFacts(**facts) for name, facts in found["kernels"].items()}
        for name, problem in found["problems"].items():
            print(f"emulated CUDA: {name} is not translated: {problem}", file=sys.stderr)
        handle = self.device.streams.handle()
        self.device.ptx.append(ptx)
        self.modules[handle] = Module(library, kernels, found["shared_size"], {}, FlowTables(found["flow"]))
        self.device.faults.counts["modules"] += 1
        return handle

    def _library(self, ptx: str) -> Path:
        settings = self.device.settings
        optimisation = settings.optimisation or ("-O0" if ptx.count("\n") > LONG else "-O1")
        # Without optimisation the runtime looks at what is checked
        looks = optimisation == "-O0" and self.check is not Check.COUNT
        check = Check.MEMORY if looks else self.check
        flags = [optimisation, *FLAGS, *native_library.target_flags(), *CHECK_FLAGS[check]]
        tool = [path.read_bytes() for path in TRANSLATOR]
        path = settings.cache / f"{native_library.digest(ptx, *tool, *flags)}.so"
        if not path.exists():
            begin = time.perf_counter()
            module = PtxModule(ptx)
            source = path.with_name(f"{path.stem}.{os.getpid()}.c")
            path.parent.mkdir(parents=True, exist_ok=True)
            source.write_text(module.translate(), encoding="utf-8")
            kernels = {name: dataclasses.asdict(facts) for name, facts in module.kernels.items()}
            facts = {"kernels": kernels, "shared_size": module.shared_size, "problems": module.problems}
            facts["flow"] = module.flow.facts()
            part = source.with_suffix(".json.part")
            part.write_text(json.dumps(facts), encoding="utf-8")
            part.rename(path.with_suffix(".json"))
            native_library.compile_library(["gcc", *flags, f"-I{native_library.HERE}", str(source), "-lm"], path)
            source.unlink()
            self.device.compile_seconds += time.perf_counter() - begin
        return path

    def kernel(self, module_handle: int, name: str) -> int:
        """Handle of a kernel; 0 where the module has none of this name."""
        module = self.modules[module_handle]
        if name not in module.handles:
            if name not in module.kernels:
                self.device.faults.fail(500, "cuModuleGetFunction", f"no kernel {name}")
                return 0
            address = ctypes.cast(getattr(module.library, c_name("k_" + name)), ctypes.c_void_p).value or 0
            handle = self.device.streams.handle()
            self.kernels[handle] = Kernel(name, address, module.kernels[name], module.shared_size, module.flow)
            module.handles[name] = handle
            self.device.kernel_count += 1
        return module.handles[name]

    def launch(
        self, handle: int, grid: tuple[int, int, int], block: int, shared: int, arguments: list[int], stream: int
    ) -> int:
        """Queue a launch with the values that lie at `arguments` now; CUDA's code."""
        kernel, faults = self.kernels[handle], self.device.faults
        sizes = kernel.facts.argument_sizes
        problem = ""
        if block > BLOCK_THREADS:
            problem = f"{block} threads in a block of {kernel.name}"
        elif len(arguments) != len(sizes):
            problem = f"{kernel.name} has {len(sizes)} arguments, not {len(arguments)}"
        elif sum(sizes) > ARGUMENT_BYTES:
            problem = f"{sum(sizes)} bytes of arguments of {kernel.name}"
        if problem:
            faults.fail(1, "cuLaunchKernel", problem)
            return 1
        copies = [ctypes.create_string_buffer(ctypes.string_at(a, n), n) for a, n in zip(arguments, sizes, strict=True)]
        params = (ctypes.c_void_p * max(len(copies), 1))(*[ctypes.addressof(each) for each in copies])
        grid_values, block_values = (ctypes.c_uint32 * 3)(*grid), (ctypes.c_uint32 * 3)(block, 1, 1)
        name = kernel.name.encode()

        def launch() -> int:
            waits = kernel.facts.barrier and block > WARP
            self.device.counts.prepare(kernel.name, None if waits else kernel.flow, block)
            code: int = self.device.runtime.emu_launch(
                ctypes.c_void_p(kernel.address), name, params, grid_values, block_values,
                ctypes.c_uint32(kernel.shared_size), ctypes.c_uint32(shared), ctypes.c_uint64(self.device.next_seed()),
                int(kernel.facts.barrier),
            )  # fmt: skip
            return code

        ok = self.device.streams.submit(
            stream, lambda: self.device.run_kernel(launch), "wp_cuda_launch_kernel", keep=(params, *copies)
        )
        return 0 if ok else faults.sticky or 900
