"""Random changes of images: what a shift, a brighter light and another contrast do, and that they are reproducible."""

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from simwarp.train.config import AugmentationConfig
from simwarp.train.networks.augmentation import ImageChanges, augment, augment_groups, change, draw_changes

SHIFT = AugmentationConfig(shift=4)


def pictures(count=5, height=37, width=41, channels=3):
    generator = torch.Generator().manual_seed(3)
    return torch.randint(0, 256, (count, height, width, channels), dtype=torch.uint8, generator=generator)


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize("offset", [(0, 0), (4, 4), (8, 8), (1, 7), (8, 0)])
def test_a_known_shift_is_a_crop_of_the_image_with_its_edges_repeated(offset):
    images = pictures()
    shift = torch.tensor([offset]).expand(len(images), 2)
    wide = np.pad(images.numpy(), ((0, 0), (4, 4), (4, 4), (0, 0)), mode="edge")
    down, right = offset
    expected = wide[:, down : down + 37, right : right + 41]
    assert np.array_equal(change(images, ImageChanges(shift, widened=4)).numpy(), expected)


def test_the_middle_of_the_range_is_no_shift():
    images = pictures()
    assert torch.equal(change(images, ImageChanges(torch.full((5, 2), 3), widened=3)), images)


def test_each_image_is_changed_by_itself():
    images = pictures()
    changes = draw_changes(5, AugmentationConfig(shift=4, brightness=0.2, contrast=0.5), seeded())
    together = change(images, changes)
    assert changes.tones is not None
    for one in range(5):
        alone = ImageChanges(changes.shift[one : one + 1], 4, changes.tones[:, one : one + 1])
        assert torch.equal(change(images[one : one + 1], alone)[0], together[one])
    images[3] = 0
    again = change(images, changes)
    others = [0, 1, 2, 4]
    assert torch.equal(again[others], together[others])


def test_light_and_contrast_do_what_they_say():
    images = pictures()
    tones = torch.tensor([[1.0, 1.0, 0.5, 0.0, 2.0], [0.0, 30.0, 0.0, 0.0, -10.0]])
    changed = change(images, ImageChanges(torch.zeros(5, 2, dtype=torch.int64), 0, tones)).numpy()
    numbers = images.numpy().astype(np.float64)
    for one, (gain, offset) in enumerate(tones.T.tolist()):
        mean = numbers[one].mean()
        expected = np.clip(mean + gain * (numbers[one] - mean) + offset, 0.0, 255.0)
        # Half a number of rounding, and sums in float32
        assert np.abs(changed[one] - expected).max() <= 0.5 + 1e-3
    assert np.array_equal(changed[0], images[0].numpy())
    assert changed[3].min() == changed[3].max()


def test_the_given_images_stay_and_the_kind_is_kept():
    images = pictures()
    before = images.clone()
    for config in (AugmentationConfig(), SHIFT, AugmentationConfig(brightness=1.0, contrast=1.0)):
        changed = augment(images, seeded(), config=config)
        assert changed.dtype == torch.uint8
        assert changed.shape == images.shape
        assert changed.data_ptr() != images.data_ptr()
        assert torch.equal(images, before)
    assert torch.equal(augment(images, seeded(), config=AugmentationConfig()), before)


def test_the_seed_decides():
    images = pictures(32)
    assert torch.equal(augment(images, seeded(1)), augment(images, seeded(1)))
    assert not torch.equal(augment(images, seeded(1)), augment(images, seeded(2)))
    torch.manual_seed(5)
    first = augment(images)
    torch.manual_seed(5)
    assert torch.equal(augment(images), first)


def test_shifts_take_every_place_of_their_range():
    changes = draw_changes(4000, SHIFT, seeded())
    assert changes.tones is None
    counts = np.bincount(changes.shift.flatten().numpy(), minlength=9)
    assert len(counts) == 9
    # 8000 draws over nine places: 889 each, deviation 28; six of them
    assert np.abs(counts - 8000 / 9).max() < 170


def test_only_groups_of_images_change():
    groups = TensorDict({"camera": pictures(), "policy": torch.randn(5, 7), "depth": torch.rand(5, 37, 41, 1)}, [5])
    changed = augment_groups(groups, seeded(), config=SHIFT)
    assert torch.equal(changed["camera"], augment(pictures(), seeded(), config=SHIFT))
    assert changed["policy"] is groups["policy"]
    assert changed["depth"] is groups["depth"]


def test_other_images_are_refused():
    with pytest.raises(ValueError, match=r"must be \(N, H, W, C\) uint8, got \(2, 36, 36, 3\) torch.float32"):
        augment(torch.zeros(2, 36, 36, 3))
    with pytest.raises(ValueError, match="uint8, got"):
        augment(torch.zeros(36, 36, 3, dtype=torch.uint8))
