"""The loop that all tasks share, one thread per world: actions, clocks, verdicts, statistics, and the last steps.

Nothing is summed over worlds: statistics have a row for each, which the host adds up when it looks. Where worlds have N
agents each, verdicts and statistics have a row for each agent, W * N rows, those of a world beside each other.
"""

import warp as wp

# Sums and products are rounded one by one, as torch does
wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})


@wp.struct
class Clocks:
    """Counters of the running episodes."""

    episode: wp.array[wp.int64]  # (W,)
    steps: wp.array[wp.int64]  # (W,) since the last reset
    limit: wp.array[wp.int64]  # (W,) what the step limit looks at
    drawn_level: wp.array[float]  # (W,) of the curriculum as the episode began: what it draws hangs on it


@wp.struct
class Recording:
    """The last control steps; a world's part stays as it is once its physics broke down, or a value of the task was not
    finite. Of no length: none is made.
    """

    count: wp.array[wp.int64]  # (W,) control steps so far
    broken_at: wp.array[wp.int64]  # (W,) the count of the first break, -1 without one
    value: wp.array[int]  # (W,) what broke then: 0 the physics, else 1 + the index of a value, as in `FirstBad`
    episode: wp.array[wp.int64]  # (W,) of the first break
    steps: wp.array[wp.int64]  # (W,)
    drawn_level: wp.array[float]  # (W,)
    level: wp.array2d[float]  # (rows, W), in a ring: it may move within an episode
    request: wp.array3d[float]  # (rows, W, A), in a ring
    joint_q: wp.array3d[float]  # (rows, W, dofs)
    joint_qd: wp.array3d[float]


@wp.struct
class Rules:
    """What a verdict hangs on."""

    terminal_count: int  # the first reasons, which are ends; the others cut off
    step_limit: wp.int64
    winning: wp.array[wp.bool]  # (R,) reasons that count as a success
    judged: int  # 1: a metric tells success
    climbing: wp.array[int]  # (1,) 1: successes move the level
    up: float
    down: float


@wp.struct
class Verdict:
    """What a control step hands out beside observations."""

    terms: wp.array2d[float]  # (W, T), finite afterwards
    rewards: wp.array[float]  # (W,)
    end_reason: wp.array[wp.int64]  # (W,)
    terminated: wp.array[wp.bool]  # (W,)
    truncated: wp.array[wp.bool]
    success: wp.array[wp.bool]
    non_finite: wp.array[wp.bool]
    ended: wp.array[wp.bool]


@wp.struct
class Tally:
    """Statistics of every world."""

    running: wp.array2d[float]  # (W, T) of the running episode
    term_sums: wp.array2d[wp.float64]  # (W, T) of those that ended
    length_sums: wp.array[wp.int64]  # (W,)
    reason_counts: wp.array2d[wp.int64]  # (W, R)
    successes: wp.array[wp.int64]  # (W,)
    bad_terms: wp.array2d[wp.int64]  # (W, T)


@wp.struct
class FirstBad:
    """The first value of a task that was not finite while the physics was sound, a row for each agent."""

    seen: wp.array[int]  # (1,) 1: there is one in any row
    count: wp.array[wp.int64]  # (rows,) control steps judged so far
    at: wp.array[wp.int64]  # (rows,) the count then, -1 without one
    episode: wp.array[wp.int64]  # (rows,)
    steps: wp.array[wp.int64]  # (rows,) of the episode
    value: wp.array[int]  # (rows,) index of a reward term, or T + that of an observation group


@wp.func
def clipped(value: float) -> float:
    """Within -1 and 1; NaN stays."""
    result = value
    if value < -1.0:
        result = -1.0
    if value > 1.0:
        result = 1.0
    return result


@wp.func
def moved(request: float, action: float, reach: float) -> float:
    """As near to a request as a reach takes an action; NaN of either stays."""
    result = wp.max(wp.min(request, action + reach), action - reach)
    if wp.isnan(request) or wp.isnan(action):
        result = request + action
    return result


@wp.func
def follow(world: int, reach: wp.array[float], request: wp.array2d[float], action: wp.array2d[float]):
    """Clip what the policy asks for, and move the action towards it for a physics step; without a reach, to it."""
    for i in range(action.shape[1]):
        asked = clipped(request[world, i])
        request[world, i] = asked
        if reach.shape[0] > 0:
            asked = moved(asked, action[world, i], reach[i])
        action[world, i] = asked


@wp.func
def is_broken(status: wp.array[int], world: int) -> bool:
    """Whether the physics of a world broke down; a task without physics has no status."""
    broken = False
    if status.shape[0] > 0:
        broken = (status[world] & 1) != 0
    return broken


@wp.kernel
def move_actions(
    steps: float, reach: wp.array[float], request: wp.array2d[float], action: wp.array2d[float]
):  # fmt: skip
    """Clip what the policy asks for, and move the actions towards it for so many physics steps, or to it."""
    world, i = wp.tid()
    request[world, i] = clipped(request[world, i])
    if reach.shape[0] > 0:
        action[world, i] = moved(request[world, i], action[world, i], reach[i] * steps)
    else:
        action[world, i] = request[world, i]


@wp.func
def hold_recording(world: int, count: wp.int64, value: int, clocks: Clocks, recording: Recording):
    """Let the recording of a world stay as it is, for what broke in its step of this count."""
    recording.broken_at[world] = count
    recording.value[world] = value
    recording.episode[world] = clocks.episode[world]
    recording.steps[world] = clocks.steps[world]
    recording.drawn_level[world] = clocks.drawn_level[world]


@wp.kernel
def count_step(
    status: wp.array[int], level: wp.array[float], request: wp.array2d[float], joint_q: wp.array2d[float],
    joint_qd: wp.array2d[float], clocks: Clocks, recording: Recording,
):  # fmt: skip
    """Count a control step whose physics is done, and record it."""
    world = wp.tid()
    clocks.steps[world] = clocks.steps[world] + wp.int64(1)
    clocks.limit[world] = clocks.limit[world] + wp.int64(1)
    rows = recording.request.shape[0]
    if rows == 0:
        return
    count = recording.count[world]
    recording.count[world] = count + wp.int64(1)
    if recording.broken_at[world] >= wp.int64(0):
        return
    row = int(count % wp.int64(rows))
    recording.level[row, world] = level[world]
    for i in range(request.shape[1]):
        recording.request[row, world, i] = request[world, i]
    for i in range(joint_q.shape[1]):
        recording.joint_q[row, world, i] = joint_q[world, i]
        recording.joint_qd[row, world, i] = joint_qd[world, i]
    if is_broken(status, world):
        hold_recording(world, count, 0, clocks, recording)


@wp.func
def note_bad(row: int, world: int, value: int, clocks: Clocks, bad: FirstBad, recording: Recording):
    """Note a value that is not finite, and end the recording of its world: what led there is kept."""
    if bad.at[row] < wp.int64(0):
        bad.at[row] = bad.count[row]
        bad.episode[row] = clocks.episode[world]
        bad.steps[row] = clocks.steps[world]
        bad.value[row] = value
        bad.seen[0] = 1
    # Right after a reset there is no step that could be repeated
    if recording.request.shape[0] > 0 and clocks.steps[world] > wp.int64(0):
        if recording.broken_at[world] < wp.int64(0):
            hold_recording(world, recording.count[world] - wp.int64(1), 1 + value, clocks, recording)


@wp.func
def first_reason(
    row: int, broken: bool, late: bool, flags: wp.array2d[wp.bool]
) -> int:  # fmt: skip
    """Index of the first reason to end: broken physics, those of the task, the step limit; -1 where it goes on."""
    if broken:
        return 0
    for i in range(flags.shape[1]):
        if flags[row, i]:
            return i + 1
    if late:
        return flags.shape[1] + 1
    return -1


@wp.func
def is_terminal(row: int, broken: bool, terminal_count: int, flags: wp.array2d[wp.bool]) -> bool:
    """Whether one of the reasons that are ends holds: one that cuts off counts only where none does."""
    terminal = broken
    for i in range(terminal_count - 1):
        terminal = terminal or flags[row, i]
    return terminal


@wp.func
def judge_row(
    row: int, world: int, broken: bool, late: bool, flags: wp.array2d[wp.bool], won: wp.array[wp.bool], rules: Rules,
    clocks: Clocks, verdict: Verdict, tally: Tally, bad: FirstBad, recording: Recording,
) -> bool:  # fmt: skip
    """Add up the rewards of a row, find out whether its episode is over and why, and keep statistics.

    Args: row, its world, whether the physics of it broke down, whether its time is over.
    """
    bad.count[row] = bad.count[row] + wp.int64(1)
    reason = first_reason(row, broken, late, flags)
    ended = reason >= 0
    terminated = is_terminal(row, broken, rules.terminal_count, flags)
    reward = float(0.0)
    for i in range(verdict.terms.shape[1]):
        term = verdict.terms[row, i]
        if not wp.isfinite(term) or broken:
            if not broken:
                tally.bad_terms[row, i] = tally.bad_terms[row, i] + wp.int64(1)
                note_bad(row, world, i, clocks, bad, recording)
            term = 0.0
        verdict.terms[row, i] = term
        reward = reward + term
        running = tally.running[row, i] + term
        if ended:
            tally.term_sums[row, i] = tally.term_sums[row, i] + wp.float64(running)
            running = 0.0
        tally.running[row, i] = running
    success = False
    if ended:
        tally.length_sums[row] = tally.length_sums[row] + clocks.steps[world]
        tally.reason_counts[row, reason] = tally.reason_counts[row, reason] + wp.int64(1)
        if rules.judged == 1:
            success = won[row] and not broken  # NaN makes every comparison false, and its negation true
        else:
            success = rules.winning[reason]
        if success:
            tally.successes[row] = tally.successes[row] + wp.int64(1)
    verdict.rewards[row] = reward
    verdict.end_reason[row] = wp.int64(reason)
    verdict.terminated[row] = terminated
    verdict.truncated[row] = ended and not terminated
    verdict.success[row] = success
    verdict.non_finite[row] = broken
    return ended


@wp.func
def leave_out(row: int, verdict: Verdict, bad: FirstBad):
    """The verdict on an agent that was done before: nothing paid, nothing ended."""
    bad.count[row] = bad.count[row] + wp.int64(1)
    for i in range(verdict.terms.shape[1]):
        verdict.terms[row, i] = 0.0
    verdict.rewards[row] = 0.0
    verdict.end_reason[row] = wp.int64(-1)
    verdict.terminated[row] = False
    verdict.truncated[row] = False
    verdict.success[row] = False
    verdict.non_finite[row] = False


@wp.func
def climbed(level: float, success: bool, rules: Rules, share: float) -> float:
    """The curriculum's level after an episode, which counts for a share."""
    change = -rules.down
    if success:
        change = rules.up
    return wp.clamp(level + share * change, 0.0, 1.0)


@wp.kernel
def judge(
    status: wp.array[int], flags: wp.array2d[wp.bool], won: wp.array[wp.bool], rules: Rules, clocks: Clocks,
    level: wp.array[float], verdict: Verdict, tally: Tally, bad: FirstBad, recording: Recording,
):  # fmt: skip
    """Judge a step of worlds of one agent each."""
    world = wp.tid()
    late = clocks.limit[world] >= rules.step_limit
    ended = judge_row(
        world, world, is_broken(status, world), late, flags, won, rules, clocks, verdict, tally, bad, recording
    )  # fmt: skip
    if rules.climbing[0] == 1 and ended:
        level[world] = climbed(level[world], verdict.success[world], rules, 1.0)
    verdict.ended[world] = ended


@wp.kernel
def judge_agents(
    status: wp.array[int], flags: wp.array2d[wp.bool], won: wp.array[wp.bool], rules: Rules, clocks: Clocks,
    level: wp.array[float], verdict: Verdict, tally: Tally, bad: FirstBad, recording: Recording,
    done: wp.array2d[wp.bool], acting: wp.array2d[wp.bool],
):  # fmt: skip
    """Judge a step of worlds of several agents: a world's episode is over once all of its agents are done.

    Args: as `judge`, rows being agents, those of a world beside each other; agents that are done, and those that took
    part in this step.
    """
    world = wp.tid()
    agents = done.shape[1]
    broken = is_broken(status, world)
    late = clocks.limit[world] >= rules.step_limit
    all_done = bool(True)
    for agent in range(agents):
        row = world * agents + agent
        part = not done[world, agent]
        acting[world, agent] = part
        if part:
            over = judge_row(
                row, world, broken, late, flags, won, rules, clocks, verdict, tally, bad, recording
            )  # fmt: skip
            done[world, agent] = over
            all_done = all_done and over
            if rules.climbing[0] == 1 and over:
                level[world] = climbed(level[world], verdict.success[row], rules, 1.0 / float(agents))
        else:
            leave_out(row, verdict, bad)
    verdict.ended[world] = all_done


@wp.kernel
def rest_agents(resting: wp.array[float], done: wp.array2d[wp.bool], asked: wp.array2d[float]):
    """What agents that are done ask for, whatever a policy says: components agent by agent."""
    world, agent = wp.tid()
    if done[world, agent]:
        size = resting.shape[0]
        for i in range(size):
            asked[world, agent * size + i] = resting[i]


@wp.kernel
def wake_agents(mask: wp.array[wp.bool], done: wp.array2d[wp.bool]):
    """In the worlds of the mask no agent is done."""
    world, agent = wp.tid()
    if mask[world]:
        done[world, agent] = False


@wp.kernel
def begin_episodes(mask: wp.array[wp.bool], level: wp.array[float], clocks: Clocks, action: wp.array2d[float]):
    """Count an episode, note its level, and forget the action, in the worlds of the mask."""
    world = wp.tid()
    if mask[world]:
        clocks.episode[world] = clocks.episode[world] + wp.int64(1)
        clocks.steps[world] = wp.int64(0)
        clocks.limit[world] = wp.int64(0)
        clocks.drawn_level[world] = level[world]
        for i in range(action.shape[1]):
            action[world, i] = 0.0


@wp.kernel
def count_bad(
    group: wp.array2d[float], column: int, counts: wp.array2d[wp.int64], value: int, clocks: Clocks, bad: FirstBad,
    recording: Recording,
):  # fmt: skip
    """Count the worlds whose observation is not finite.

    Args: observation, its column of the counts and those, its index among the values of the task.
    """
    world = wp.tid()
    for i in range(group.shape[1]):
        if not wp.isfinite(group[world, i]):
            counts[world, column] = counts[world, column] + wp.int64(1)
            note_bad(world * (bad.at.shape[0] // group.shape[0]), world, value, clocks, bad, recording)
            return


@wp.func
def is_kept(broken_at: wp.array[wp.int64], row: int, rows: int) -> bool:
    """Whether a row of an array, of which each world has the same number, belongs to a world that is recorded."""
    return broken_at[row * broken_at.shape[0] // rows] < wp.int64(0)


@wp.kernel
def keep_words(broken_at: wp.array[wp.int64], present: wp.array2d[int], kept: wp.array2d[int]):
    """Copy rows of the present state, in the worlds that have not broken down."""
    row, i = wp.tid()
    if is_kept(broken_at, row, present.shape[0]):
        kept[row, i] = present[row, i]


@wp.kernel
def keep_bytes(broken_at: wp.array[wp.int64], present: wp.array2d[wp.uint8], kept: wp.array2d[wp.uint8]):
    """The same of rows that are no whole words."""
    row, i = wp.tid()
    if is_kept(broken_at, row, present.shape[0]):
        kept[row, i] = present[row, i]
