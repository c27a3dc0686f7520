#!/bin/bash
# The first day on a machine with a GPU: everything that cannot be measured without one, in the order of its value.
#
#     scripts/gpu_day.sh [--rehearse] [FOLDER] [STAGE ...]       # by default runs/gpu_day, all stages
#
# --rehearse runs the same stages small on the emulated device, on any Linux machine: it finds what would stop the day, and
# measures nothing.
# Every stage stands alone: it writes FOLDER/STAGE.log and FOLDER/STAGE.json with the hardware named, a failing one does
# not stop the next, and what a machine lacks is skipped by name. LIMIT is the patience per stage [s].
# Exit code: 0 if every stage passed or was skipped.
set -u
cd "$(dirname "$0")/.."
REHEARSE=0
[ "${1:-}" = --rehearse ] && REHEARSE=1 && shift
OUT=${1:-runs/gpu_day}
[ $# -gt 0 ] && shift
CHOSEN=" $* "
mkdir -p "$OUT"
PY=${PY:-.venv/bin/python}
DEVICE=${DEVICE:-cuda:0}
FAILED=0
WORLDS=32
ANTS=4096
TRUCKS=1024
ITERATIONS=100
if [ $REHEARSE = 1 ]; then
    PY="$PY tests/emulated_cuda"
    LIMIT=${LIMIT:-3600}
    GPU=1 WORLDS=4 ANTS=8 TRUCKS=4 ITERATIONS=2
else
    LIMIT=${LIMIT:-900}
    GPU=$($PY -c 'import warp as wp; wp.config.quiet = True; print(int(wp.is_cuda_available()))' 2>/dev/null | tail -1)
fi
GPU=${GPU:-0}
SW="$PY -m simwarp"

# stage NAME NEEDS COMMAND...: NEEDS is gpu, or the name of a program beside it
stage() {
    local name=$1 needs=$2
    shift 2
    [ "$CHOSEN" != "  " ] && [[ "$CHOSEN" != *" $name "* ]] && return
    local lacking=""
    [ "$GPU" != 1 ] && lacking="no CUDA device"
    [ -z "$lacking" ] && [ "$needs" != gpu ] && ! command -v "$needs" > /dev/null &&
        lacking="$needs is not installed"
    if [ -n "$lacking" ]; then
        echo "skipped  $name: $lacking"
        return
    fi
    local begin=$SECONDS
    timeout "$LIMIT" "$@" > "$OUT/$name.log" 2>&1
    local code=$?
    if [ $code -eq 0 ]; then
        echo "passed   $name in $((SECONDS - begin)) s"
    else
        echo "FAILED   $name in $((SECONDS - begin)) s (exit code $code): $(tail -1 "$OUT/$name.log")"
        FAILED=1
    fi
}

bench() { # NAME SCENE WORLDS [more]
    local name=$1 scene=$2 worlds=$3
    shift 3
    [ $REHEARSE = 1 ] && worlds=4,8 && set -- --seconds 0.05 "$@"
    stage "$name" gpu $SW bench "$scene" --worlds "$worlds" --device "$DEVICE" --json "$OUT/$name.json" "$@"
}

# 1. Does it compile, and how long does that take with an empty cache
stage compile gpu env WARP_CACHE_PATH="$OUT/cache" $PY -m scripts.gpu_compile "$DEVICE" "$OUT/compile.json"
# 2. Is it right: tests of a GPU, then every scene and sensor against the CPU
stage tests gpu $PY -m pytest -m cuda -q
stage doctor gpu $SW doctor --gpu --device "$DEVICE" --worlds $WORLDS --json "$OUT/doctor.json"
stage verify gpu $SW verify --device "$DEVICE" --json "$OUT/verify.json"
# 3. How fast: numbers of worlds, sizes of blocks, beside the CPU and the peers of the same machine
bench ant ant 1024,4096,8192,16384,32768,65536
bench hmmwv hmmwv 1024,4096,8192,32768
bench camera camera 64,256,1024
bench stack stack 256,1024,4096
bench hmmwv_soil hmmwv-soil 256,1024,4096
bench hmmwv_soil_10cm hmmwv-soil 1024,4096 --spacing 0.1
for size in 64 128 256; do
    export SIMWARP_BLOCK_DIM=$size
    bench "ant_blocks_$size" ant 8192,32768
    bench "hmmwv_blocks_$size" hmmwv 4096
done
unset SIMWARP_BLOCK_DIM
stage ant_cpu gpu $SW bench ant --worlds $TRUCKS --device cpu --seconds 2 --json "$OUT/ant_cpu.json"
bench peers ant 8192 --peers
# 4. The control step of a task, and training
bench ant_task ant-task 1024,4096,16384
bench off_road_task off-road 256,1024,4096
stage train_ant gpu $SW train ant --num-envs $ANTS --iterations $ITERATIONS --device "$DEVICE" --json "$OUT/train_ant.json"
stage train_off_road gpu $SW train off-road --num-envs $TRUCKS --iterations $((ITERATIONS < 30 ? ITERATIONS : 30)) --device "$DEVICE" \
    --json "$OUT/train_off_road.json"
# 5. Why it is as fast as it is
COUNTERS=sm__warps_active.avg.pct_of_peak_sustained_active,smsp__inst_executed.sum
COUNTERS+=,l1tex__t_sectors_pipe_lsu_mem_global_op_ld.sum,l1tex__t_requests_pipe_lsu_mem_global_op_ld.sum
COUNTERS+=,dram__bytes.sum,smsp__warp_issue_stalled_no_instruction_per_warp_active.pct
stage counters_ant ncu ncu --metrics $COUNTERS -k regex:worlds -c 12 \
    $SW bench ant --worlds $((2 * ANTS)) --device "$DEVICE" --seconds 0.1
stage timeline_ant nsys nsys profile -f true -t cuda,nvtx -o "$OUT/timeline_ant" \
    $SW train ant --num-envs $((2 * ANTS)) --iterations 3 --device "$DEVICE"
exit $FAILED
