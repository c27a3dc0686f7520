"""Shipped vehicles with one value changed, and what the loader says of them."""

import json
from typing import Any

import pytest

from simwarp.vehicle.spec.vehicle_files import load_vehicle, plain, vehicle_names
from simwarp.vehicle.spec.vehicle_spec import SpecError


@pytest.fixture(scope="module")
def shipped() -> dict[str, Any]:
    return {name: plain(load_vehicle(name)) for name in vehicle_names()}


@pytest.fixture
def changed(shipped, tmp_path):
    """The error of a shipped vehicle in which one value is another; None removes it."""

    def error(keys: str, value: object, name: str = "hmmwv") -> str:
        data = json.loads(json.dumps(shipped[name]))
        *path, last = [int(key) if key.isdigit() else key for key in keys.split(".")]
        holder = data
        for key in path:
            holder = holder[key]
        if value is None:
            del holder[last]
        else:
            holder[last] = value
        (tmp_path / "v.json").write_text(json.dumps(data))
        with pytest.raises(SpecError) as caught:
            load_vehicle(tmp_path / "v.json")
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 300
        return str(caught.value)

    return error
