"""Counter-based random numbers: known answers, uniformity, and independence of everything but their coordinates."""

import hashlib
import math

import pytest
import torch

from simwarp.tasks.randomisation.randomness import WorldRandom, mix64

GAMMA = 0x9E3779B97F4A7C15


def make(worlds, seed=0, episode=0, step=0, first_world=0):
    return WorldRandom(seed, torch.full((worlds,), episode), torch.full((worlds,), step), first_world)


def test_the_hash_is_splitmix64():
    # First outputs of Vigna's splitmix64.c for seed 1234567
    known = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431, 16408922859458223821]
    assert [mix64(1234567 + (k + 1) * GAMMA) for k in range(5)] == known


@pytest.mark.parametrize("per_step", [False, True])
def test_kernels_hash_once_per_coordinate(per_step):
    seed, world, episode, step = 2**62 + 3, 5, 7, 11
    digest = int.from_bytes(hashlib.blake2b(b"start", digest_size=8).digest(), "little")
    key = mix64((world + 1) * GAMMA + mix64(mix64(seed * GAMMA) ^ digest))
    key = mix64(episode * GAMMA + key)
    if per_step:
        key = mix64(step * GAMMA + key)
    wanted = [mix64((column + 1) * GAMMA + key) for column in range(3)]
    bits = make(2, seed, episode, step, world - 1).bits("start", 3, per_step=per_step)
    assert [value % 2**64 for value in bits[1].tolist()] == wanted
    uniform = make(2, seed, episode, step, world - 1).uniform("start", -1.0, 3.0, 3, per_step=per_step)
    assert uniform[1].tolist() == pytest.approx([4.0 * (value >> 40) / 2**24 - 1.0 for value in wanted], abs=3e-7)


def test_a_draw_may_be_changed_and_kept():
    random = make(4)
    first = random.uniform("a", size=2)
    kept = first.clone()
    second = random.uniform("a", size=2).neg_()
    assert torch.equal(first, kept)
    assert torch.equal(second, -kept)


def test_draws_do_not_depend_on_the_number_of_worlds():
    many, few = make(17, seed=5), make(2, seed=5)
    assert torch.equal(many.uniform("start", size=3)[:2], few.uniform("start", size=3))
    part = make(4, seed=5, first_world=13)
    assert torch.equal(many.normal("noise", size=3)[13:], part.normal("noise", size=3))


def test_draws_repeat_and_do_not_advance_anything():
    random = make(8, seed=1)
    first = random.uniform("a", size=2)
    random.uniform("b", size=5)
    assert torch.equal(first, random.uniform("a", size=2))


def test_a_longer_draw_begins_like_a_shorter_one():
    random = make(8)
    assert torch.equal(random.bits("a", 5)[:, :2], random.bits("a", 2))


@pytest.mark.parametrize("change", [{"seed": 1}, {"episode": 1}, {"first_world": 64}])
def test_every_coordinate_matters(change):
    base = make(64).uniform("a", size=4)
    other = make(64, **change).uniform("a", size=4)
    assert (base == other).float().mean() < 0.02


def test_purpose_and_step_matter():
    random = make(64)
    assert (random.uniform("a", size=4) == random.uniform("b", size=4)).float().mean() < 0.02
    later = make(64, step=1)
    assert torch.equal(random.uniform("a", size=4), later.uniform("a", size=4))
    per_step = random.uniform("a", size=4, per_step=True)
    assert (per_step == later.uniform("a", size=4, per_step=True)).float().mean() < 0.02


def test_reseeding_changes_the_draws_at_once():
    random = make(64)
    first = random.uniform("a")
    random.reseed(9)
    assert not torch.equal(first, random.uniform("a"))
    random.reseed(0)
    assert torch.equal(first, random.uniform("a"))


def chi_square(values, bins):
    counts = torch.histc(values, bins, 0.0, 1.0)
    expected = values.numel() / bins
    return float(((counts - expected) ** 2 / expected).sum())


def test_uniform_over_worlds_episodes_steps_and_components():
    bins = 64
    # The 1e-6 quantile of chi-square with 63 degrees of freedom is 130: a fixed stream passes or fails for good
    assert chi_square(make(65536).uniform("u").flatten(), bins) < 130.0
    episodes = torch.arange(65536)
    zero = torch.zeros(65536, dtype=torch.int64)
    over_episodes = WorldRandom(0, episodes, zero)
    over_episodes.world.zero_()  # one world through many episodes
    assert chi_square(over_episodes.uniform("u").flatten(), bins) < 130.0
    over_steps = WorldRandom(0, zero, episodes)
    over_steps.world.zero_()
    assert chi_square(over_steps.uniform("u", per_step=True).flatten(), bins) < 130.0
    assert chi_square(make(1).uniform("u", size=65536).flatten(), bins) < 130.0


def test_neighbouring_coordinates_are_uncorrelated():
    values = make(65536).uniform("u", size=2).double() - 0.5
    scale = 12.0 / math.sqrt(65536)
    # Correlation of n independent pairs has deviation 1/sqrt(n); five of them
    assert abs(float((values[:, 0] * values[:, 1]).sum()) * 12 / 65536) < 5 * scale / 12
    assert abs(float((values[1:, 0] * values[:-1, 0]).sum()) * 12 / 65536) < 5 * scale / 12


def test_ranges_and_moments():
    random = make(200_000)
    uniform = random.uniform("u", -2.0, 3.0)
    assert uniform.dtype == torch.float32
    assert float(uniform.min()) >= -2.0
    assert float(uniform.max()) < 3.0
    assert abs(float(uniform.mean()) - 0.5) < 5 * 5.0 / math.sqrt(12 * 200_000)
    normal = random.normal("n", 1.0, 2.0).double()
    assert abs(float(normal.mean()) - 1.0) < 5 * 2.0 / math.sqrt(200_000)
    assert abs(float(normal.std()) - 2.0) < 5 * 2.0 / math.sqrt(400_000)
    assert torch.isfinite(normal).all()
    integers = random.integers("i", -1, 3)
    assert sorted(integers.unique().tolist()) == [-1, 0, 1, 2]
