#!/bin/bash
# Ten minutes on a machine with a GPU: what cannot be measured without one, in the order of its value.
#
#     scripts/gpu_day.sh [--rehearse] [FOLDER] [STAGE ...]       # by default runs/gpu_day, all stages
#
# --rehearse runs the same stages small on the emulated device, on any Linux machine: it finds what would stop the day, and
# measures nothing.
# Every stage stands alone: it writes FOLDER/STAGE.log and FOLDER/STAGE.json with the hardware named, a failing one does
# not stop the next, and what a machine lacks is skipped by name. LIMIT is the patience per stage [s], BUDGET that for all
# of them: what does not begin in time is skipped, what does not end is stopped. By speeds of an H200 with 16 cores
# the stages up to stack should be done in ten minutes; BUDGET=3600 is for all of them.
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
ITERATIONS=30
if [ $REHEARSE = 1 ]; then
    PY="$PY tests/emulated_cuda"
    LIMIT=${LIMIT:-3600} BUDGET=${BUDGET:-36000}
    GPU=1 WORLDS=4 ANTS=8 TRUCKS=4 ITERATIONS=2
else
    LIMIT=${LIMIT:-240} BUDGET=${BUDGET:-585}
    GPU=$($PY -c 'import warp as wp; wp.config.quiet = True; print(int(wp.is_cuda_available()))' 2>/dev/null | tail -1)
fi
GPU=${GPU:-0}
SW="$PY -m simwarp"
SHORTEST=15 # seconds that a stage is begun for
SECONDS=0

# stage NAME NEEDS COMMAND...: NEEDS is gpu, or the name of a program beside it
stage() {
    local name=$1 needs=$2
    shift 2
    [ "$CHOSEN" != "  " ] && [[ "$CHOSEN" != *" $name "* ]] && return
    local lacking=""
    [ "$GPU" != 1 ] && lacking="no CUDA device"
    [ -z "$lacking" ] && [ "$needs" != gpu ] && ! command -v "$needs" > /dev/null &&
        lacking="$needs is not installed"
    local left=$((BUDGET - SECONDS))
    [ -z "$lacking" ] && [ $left -lt $SHORTEST ] && lacking="no time left of $BUDGET s (BUDGET)"
    if [ -n "$lacking" ]; then
        echo "skipped  $name: $lacking"
        return
    fi
    local begin=$SECONDS
    timeout "$((left < LIMIT ? left : LIMIT))" "$@" > "$OUT/$name.log" 2>&1
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

# 1. Does it compile, all scenes side by side: the cache may be empty. Those for the CPU, which only the comparison needs, go
# on meanwhile at the lowest priority. Then, how fast is it
if [ $REHEARSE = 0 ] && [ "$GPU" = 1 ]; then
    nice -n 19 $PY -m scripts.gpu_kernels cpu "$OUT/kernels_cpu.json" > "$OUT/kernels_cpu.log" 2>&1 &
    trap 'kill $! 2> /dev/null' EXIT
    stage kernels gpu $PY -m scripts.gpu_kernels "$DEVICE" "$OUT/kernels.json"
fi
bench ant ant 1024,8192,16384,32768
# 2. Training, vehicles, cameras, the control step of a task; a HMMWV settles for 25 500 steps before
stage train_ant gpu $SW train ant --num-envs $ANTS --iterations $ITERATIONS --device "$DEVICE" --json "$OUT/train_ant.json"
bench hmmwv hmmwv 1024,4096,32768
bench camera camera 1024
bench ant_task ant-task 4096
bench rod rod 4096,32768
bench rod_on_floor rod-on-floor 1024,4096
stage times gpu $PY -m scripts.gpu_times "$DEVICE" "$OUT/times.json" task:ant:$ANTS task:ant:$((4 * ANTS)) \
    ant:$((2 * ANTS)) ant:$((8 * ANTS)) hmmwv:$ANTS quadruped:$((2 * ANTS)) hexapod:$((2 * ANTS)) \
    rod:$ANTS rod-on-floor:$TRUCKS stack:$((8 * WORLDS))
# 3. Is it right: every scene and sensor against the CPU
stage doctor gpu $SW doctor --gpu --device "$DEVICE" --worlds $WORLDS --json "$OUT/doctor.json"
# 4. Why it is as fast as it is
COUNTERS=gpu__time_duration.sum,launch__registers_per_thread,smsp__inst_executed.sum
COUNTERS+=,smsp__thread_inst_executed_per_inst_executed.ratio,smsp__issue_active.avg.pct_of_peak_sustained_active
COUNTERS+=,sm__warps_active.avg.pct_of_peak_sustained_active,dram__bytes_read.sum,dram__bytes_write.sum
COUNTERS+=,l1tex__t_sectors_pipe_lsu_mem_global_op_ld.sum,l1tex__t_sectors_pipe_lsu_mem_global_op_st.sum
COUNTERS+=,l1tex__t_sector_hit_rate.pct,lts__t_sector_hit_rate.pct
COUNTERS+=,smsp__average_warps_issue_stalled_long_scoreboard_per_issue_active.ratio
counters() { # SCENE WORLDS
    stage "counters_$1_$2" ncu ncu --profile-from-start off --csv --page raw --metrics $COUNTERS \
        $PY -m scripts.gpu_profile "$1" "$2" "$DEVICE"
}
counters ant $((2 * ANTS))
counters ant $((8 * ANTS))
counters hmmwv $ANTS
# 5. The slow ones: a step of 256 stacks is a fifth of a second, vehicles on soil settle for a minute
bench stack stack 256
bench hexapod hexapod 8192
bench lidar lidar 256
bench hmmwv_soil hmmwv-soil 4096
# 6. What is left: tests, the CPU and the peers of the same machine, the other task, every kernel's compilation by itself
stage tests gpu $PY -m pytest -m cuda -q
stage verify gpu $SW verify --device "$DEVICE" --json "$OUT/verify.json"
bench stack_4096 stack 4096
stage ant_cpu gpu $SW bench ant --worlds $TRUCKS --device cpu --json "$OUT/ant_cpu.json"
bench peers ant 8192 --peers
bench off_road_task off-road 1024
stage train_off_road gpu $SW train off-road --num-envs $TRUCKS --iterations $ITERATIONS --device "$DEVICE" \
    --json "$OUT/train_off_road.json"
stage timeline_ant nsys nsys profile -f true -t cuda,nvtx -o "$OUT/timeline_ant" \
    $SW train ant --num-envs $((2 * ANTS)) --iterations 3 --device "$DEVICE"
stage compile gpu env WARP_CACHE_PATH="$OUT/cache" $PY -m scripts.gpu_compile "$DEVICE" "$OUT/compile.json"
exit $FAILED
