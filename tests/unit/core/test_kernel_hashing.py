"""Hashes of kernels are those that Warp makes without being told to keep any."""

import subprocess
import sys
import textwrap

HASHES = """
    import simwarp.core.kernel_hashing as kept
    if {anew}:
        kept.hash_functions_once = lambda: None
    from simwarp.core.warp_start import start_warp
    start_warp()
    import simwarp.sensors.scene, simwarp.simulation.simulation, simwarp.soil.soil
    import warp as wp
    from simwarp.kernels.dynamics.step_stages import fused_step
    from warp._src import context

    step = fused_step(False, False, False, False)

    @wp.func
    def half(x: float):
        return 0.5 * x

    @wp.kernel(module="unique")
    def first(y: wp.array[float]):
        y[wp.tid()] = half(y[wp.tid()])

    one = first.module.get_module_hash(1)

    @wp.func
    def half(x: float):
        return 0.25 * x

    @wp.kernel(module="unique")
    def first(y: wp.array[float]):
        y[wp.tid()] = half(y[wp.tid()])

    assert first.module.get_module_hash(1) != one  # whoever is not of this package may change
    for name, module in sorted(context.user_modules.items()):
        print(name, module.get_module_hash(1).hex())
    print("kept", len(kept._hashes) > 0)
"""


def hashes(anew: bool) -> list[str]:
    code = textwrap.dedent(HASHES.format(anew=anew))
    # Warp reads functions' texts from files
    with_file = f"import linecache; code = {code!r}; linecache.cache['<probe>'] = (len(code), None, "
    with_file += "code.splitlines(True), '<probe>'); exec(compile(code, '<probe>', 'exec'))"
    done = subprocess.run([sys.executable, "-c", with_file], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_kept_hashes_are_those_made_anew():
    kept, anew = hashes(False), hashes(True)
    assert (kept.pop(), anew.pop()) == ("kept True", "kept False")
    assert len(kept) > 40
    assert kept == anew
