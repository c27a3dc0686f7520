"""Tests that are left out where all that tests make is made on the emulated device, each with its reason."""

from __future__ import annotations

NATIVE = "a step of a CPU is native code; a GPU's consists of launches"
THREADS = "threads and recordings of a CPU"

CPU_TESTS: dict[str, str] = {
    "tests/tasks/framework/test_capture.py": "graphs are emulated on a CPU; a GPU's have a test marked `cuda`",
    "tests/unit/simulation/test_attachments.py::test_a_field_is_what_a_sensor_publishes": "its text names the CPU",
    "tests/unit/simulation/test_building_in_threads.py::test_a_step_is_recorded_whole_whatever_its_threads": THREADS,
    "tests/unit/simulation/test_building_in_threads.py::test_each_thread_records_at_a_time_with_the_others": THREADS,
    "tests/unit/simulation/test_building_in_threads.py::test_one_is_built_and_stepped_while_another_thread": THREADS,
    "tests/unit/simulation/test_contact_room.py": "a CPU's few lists hold all contacts; a GPU's lists drop some",
    "tests/unit/simulation/test_recording_together.py": NATIVE,
    "tests/unit/simulation/test_step_is_recorded.py": NATIVE,
    "tests/unit/simulation/test_threads.py": THREADS,
}
"""Beginnings of names of tests, and why."""
