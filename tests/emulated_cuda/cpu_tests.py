"""Tests that are left out where all that tests make is made on the emulated device, each with its reason."""

from __future__ import annotations

HOST = "it brings tensors of the host, which a task on a GPU refuses"
NAMES = "its texts name the CPU"
NATIVE = "a step of a CPU is native code; a GPU's consists of launches"
THREADS = "threads and recordings of a CPU"
SCRIPTED = "TorchScript does not run on the emulated device"
NETWORK = "tests/tasks/actuation/test_actuator_network.py::"

CPU_TESTS: dict[str, str] = {
    f"{NETWORK}test_a_linear_network_is_a_pd_controller_and_looks_back": SCRIPTED,
    f"{NETWORK}test_it_forgets_where_an_episode_begins_and_resumes_bit_by_bit": SCRIPTED,
    f"{NETWORK}test_limited_actions_ask_once_in_each_physics_step": SCRIPTED,
    f"{NETWORK}test_worlds_do_not_meet_and_strength_is_their_own": SCRIPTED,
    "tests/tasks/framework/test_capture.py": "graphs are emulated on a CPU; a GPU's have a test marked `cuda`",
    "tests/tasks/framework/test_contract.py::test_a_command_ends_in_one_line_and_code_1": NAMES,
    "tests/tasks/framework/test_contract.py::test_the_first_value_that_is_not_finite_is_told_where_several_are": HOST,
    "tests/tasks/framework/test_non_finite.py::test_a_policy_that_returns_nan_is_not_exported":
        "torch exports no parameters of the emulated device",
    "tests/tasks/framework/test_recorded_launches.py": HOST,
    "tests/tasks/framework/test_step_check.py": "operators that read a GPU are found by those that read a CPU",
    "tests/tasks/framework/test_task_threads.py": THREADS,
    "tests/tasks/randomisation/test_mass_centres.py::test_bodies_without_joints_stay_where_they_were": HOST,
    "tests/tasks/randomisation/test_task_uncertainty.py::test_delays_that_ask_for_too_much_memory": NAMES,
    "tests/unit/simulation/test_attachments.py::test_a_field_is_what_a_sensor_publishes": NAMES,
    "tests/unit/simulation/test_building_in_threads.py::test_a_step_is_recorded_whole_whatever_its_threads": THREADS,
    "tests/unit/simulation/test_building_in_threads.py::test_each_thread_records_at_a_time_with_the_others": THREADS,
    "tests/unit/simulation/test_building_in_threads.py::test_one_is_built_and_stepped_while_another_thread": THREADS,
    "tests/unit/simulation/test_contact_room.py": "a CPU's few lists hold all contacts; a GPU's lists drop some",
    "tests/unit/simulation/test_recording_together.py": NATIVE,
    "tests/unit/simulation/test_step_is_recorded.py": NATIVE,
    "tests/unit/simulation/test_threads.py": THREADS,
}  # fmt: skip
"""Beginnings of names of tests, and why."""
