"""The oracle: runs what was made and says what is wrong with what happened. It can fail: see test_oracle.py."""

import contextlib
import dataclasses
import io
import os
import re
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tests.campaign.hostile import ACCEPT, REFUSE, Verdict, shorten
from tests.campaign.sandbox import Sandbox

HANG = 10.0
"""Time after which something counts as hanging [s]."""

START = 30.0
"""Until a process has loaded torch and its kernels, on a busy machine [s]."""

PROCESSES = {"sweep": 2}
"""Processes that a command starts one after the other."""

LONGEST_LINE = 1200
"""Characters of an error that a person still reads: a received value is shown short."""

NAMED = 16
"""Characters of a name by which a message makes it known; the rest may be cut."""

ESCAPED = re.compile(r"\\x[0-9a-f]{2}|\\u[0-9a-f]{4}|\\U[0-9a-f]{8}|[\0-\x1f]")
"""Characters as Python escapes them."""

CODES = (0, 1, 2, 130)
DRAFT = ".simwarp-"
HARMLESS = (DeprecationWarning, PendingDeprecationWarning, ResourceWarning, ImportWarning)
"""Warnings that are not about the input."""


class HangError(BaseException):
    """The alarm went off; no `except Exception` swallows it."""


@dataclasses.dataclass(frozen=True)
class Attack:
    """Something to try.

    Attributes:
        what: how to repeat it, one line.
        verdict: what a right program does.
        names: an error names at least one of these: options, files, arguments.
    """

    what: str
    verdict: Verdict
    names: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class CommandAttack(Attack):
    """A command line.

    Attributes:
        words: the arguments of `simwarp`.
        files: laid into the working folder before, by path.
        outputs: bystanders that it may write to, but not replace by something of another kind.
    """

    words: tuple[str, ...] = ()
    files: tuple[tuple[str, bytes], ...] = ()
    outputs: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class CallAttack(Attack):
    """A call of Python."""

    call: Callable[[], Any] = dataclasses.field(default=lambda: None)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What happened: `result` is accepted, refused, fell short or interrupted; `failure` is the class of what is wrong
    with it, none where all is well.
    """

    result: str
    failure: str = ""
    detail: str = ""


@contextlib.contextmanager
def alarm(seconds: float) -> Iterator[None]:
    """Raise a HangError in whatever Python code runs when the time is over."""

    def ring(number: int, frame: Any) -> None:
        # where it hangs is what its fixer wants to know
        place = next((line for line in reversed(traceback.extract_stack(frame)) if "simwarp" in line.filename), None)
        raise HangError(f"{place.filename}:{place.lineno}" if place else "no line of simwarp")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)  # again each second: a C library may have swallowed the first
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextlib.contextmanager
def captured() -> Iterator[tuple[Any, Any]]:
    """Standard output and error as text files, those of native libraries included."""
    kept = os.dup(1), os.dup(2)
    streams = sys.stdout, sys.stderr
    sys.stdout.flush(), sys.stderr.flush()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        os.dup2(out.fileno(), 1)
        os.dup2(err.fileno(), 2)
        # as in a terminal with UTF-8: standard output is strict
        sys.stdout = io.TextIOWrapper(io.FileIO(1, "w", closefd=False), "utf-8", "strict", write_through=True)
        sys.stderr = io.TextIOWrapper(io.FileIO(2, "w", closefd=False), "utf-8", "backslashreplace", write_through=True)
        try:
            yield out, err
        finally:
            sys.stdout, sys.stderr = streams
            for number, copy in zip((1, 2), kept, strict=True):
                os.dup2(copy, number)
                os.close(copy)


def _text(file: Any) -> str:
    file.seek(0)
    return file.read().decode("utf-8", "replace")


def _where(error: BaseException) -> str:
    """Kind and last line of simwarp of an exception: what its fixer looks for."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/site-packages/" not in frame.filename]
    own = [frame for frame in frames if "tests/campaign" not in frame.filename] or frames
    place = f" at {'/'.join(Path(own[-1].filename).parts[-3:])}:{own[-1].lineno}" if own else ""
    return f"{type(error).__name__}{place}: {shorten(str(error), 160)}"


@dataclasses.dataclass
class Run:
    """What a command line did."""

    code: Any
    out: str
    err: str
    error: str = ""
    hung: bool = False
    warned: tuple[str, ...] = ()


def run_in_process(words: tuple[str, ...], main: Callable[[list[str]], Any], seconds: float | None = None) -> Run:
    """Run a command line in this process."""
    code: Any = None
    error, hung = "", False
    with captured() as (out, err), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with alarm(HANG if seconds is None else seconds):
                code = main(list(words))
        except HangError as place:
            error, hung = str(place), True
        except BaseException as raised:  # noqa: BLE001 - that nothing escapes is what is tested
            error = _where(raised)
        texts = _text(out), _text(err)
    found = tuple(shorten(str(item.message)) for item in caught if not issubclass(item.category, HARMLESS))
    return Run(code, *texts, error, hung, found)


def attack_command(attack: CommandAttack, sandbox: Sandbox, main: Callable[[list[str]], Any]) -> Outcome:
    """Try a command line in a sandbox, judge it, and bring the sandbox back."""
    with sandbox.inside():
        for name, data in attack.files:
            Path(name).parent.mkdir(parents=True, exist_ok=True)
            Path(name).write_bytes(data)
        seconds = HANG + PROCESSES.get(attack.words[0] if attack.words else "", 0) * START
        run = run_in_process(attack.words, main, seconds)
        if run.hung:  # a busy machine is no hang
            run = run_in_process(attack.words, main, seconds)
        spoiled = [name for name, data in attack.files if not _holds(Path(name), data)]
    try:
        outcome = judge_command(attack, run, sandbox)
        if run.code == 2 and spoiled and not outcome.failure:
            return dataclasses.replace(outcome, failure="bystander", detail=f"{spoiled[0]} was changed by a refusal")
        return outcome
    finally:
        sandbox.restore()


def _holds(path: Path, data: bytes) -> bool:
    return path.is_file() and path.read_bytes() == data


def judge_command(attack: CommandAttack, run: Run, sandbox: Sandbox) -> Outcome:
    """What is wrong with a run, the worst first."""
    result = {0: "accepted", 1: "fell short", 2: "refused", 130: "interrupted"}.get(run.code, "crashed")
    changes = _changes(attack, sandbox)
    checks: list[tuple[str, str]] = []
    if run.hung:
        checks.append(("hang", run.error))
    elif run.error:
        checks.append(("traceback", run.error))
    elif run.code not in CODES:
        checks.append(("exit code", str(run.code)))
    checks += [("bystander", f"{shorten(path)} is {what}") for path, what in changes if what != "new"]
    checks += [("draft left", shorten(path)) for path, what in changes if what == "new" and DRAFT in path]
    if run.code == 2:
        checks += [
            ("trace of a refusal", shorten(path)) for path, what in changes if what == "new" and DRAFT not in path
        ]
        checks += _wrong_words(attack, run)
    checks += [("warning", text) for text in run.warned]
    if run.code == 0 and attack.verdict is REFUSE:
        checks.append(("silent acceptance", shorten(run.out[-160:])))
    if run.code in (1, 2) and attack.verdict is ACCEPT:
        checks.append(("refusal of what is right", shorten(run.err)))
    return Outcome(result, *checks[0]) if checks else Outcome(result)


def _changes(attack: CommandAttack, sandbox: Sandbox) -> list[tuple[str, str]]:
    """Changes that were not asked for; new files of commands that ran are, in the working folder."""
    laid = {name for name, _ in attack.files}
    found = []
    for path, what in sandbox.changes().items():
        name = os.path.relpath(path, sandbox.work)
        mine = name in laid or any(other.startswith(f"{name}/") for other in laid)
        asked = what == "of other content" and name in attack.outputs
        if not (mine or asked):
            found.append((name, what))
    return found


def _wrong_words(attack: Attack, run: Run) -> list[tuple[str, str]]:
    """What is wrong with the message of exit code 2."""
    lines = run.err.splitlines()
    if "-" in getattr(attack, "words", ()) and "--json" in getattr(attack, "words", ()):
        lines = lines[-1:]  # text for people goes to standard error then
    if len(lines) != 1 or not lines[0].startswith("simwarp: "):
        return [("not one line", shorten(run.err))]
    return wrong_message(attack, lines[0].removeprefix("simwarp: "))


def wrong_message(attack: Attack, message: str) -> list[tuple[str, str]]:
    """Whether a message is short, one line, and names what was attacked."""
    if "\n" in message:
        return [("not one line", shorten(message))]
    if len(message) > LONGEST_LINE:
        return [("too long", f"{len(message)} characters: {shorten(message)}")]
    text = _plain(message)
    if attack.names and not any(_plain(name)[:NAMED] in text for name in attack.names if name):
        return [("names nothing", f"{shorten(message, 200)}; wanted one of {', '.join(map(shorten, attack.names))}")]
    return []


def _plain(text: str) -> str:
    """What can be compared of a text that a message may show escaped, cut, or without breaks: letters and digits."""
    printed = ESCAPED.sub("", text.encode("ascii", "backslashreplace").decode()).lower().replace("_", "-")
    return "".join(character for character in printed if character.isalnum() or character in "-./")


def _is_meant(error: TypeError) -> bool:
    """Whether somebody raised it on purpose, or Python did for a call that does not fit its signature."""
    frames = traceback.extract_tb(error.__traceback__)
    return (frames[-1].line or "").startswith("raise ") or "keyword argument" in str(error)


# ---- calls of Python -------------------------------------------------------------------------------------------------


def documented() -> tuple[type[Exception], ...]:
    """Errors that the package says it raises for wrong input."""
    from simwarp.cli import input_errors

    return input_errors()


def attack_call(attack: CallAttack) -> Outcome:
    """Make a call and judge what became of it."""
    with captured() as (out, err), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result, checks = "accepted", []
        try:
            with alarm(HANG):
                attack.call()
        except HangError as place:
            result, checks = "crashed", [("hang", str(place))]
        except documented() as error:
            result, checks = "refused", wrong_message(attack, str(error))
        except TypeError as error:
            told = not wrong_message(attack, str(error)) and _is_meant(error)
            result, checks = ("refused", []) if told else ("crashed", [("traceback", _where(error))])
        except BaseException as error:  # noqa: BLE001 - that nothing else escapes is what is tested
            result, checks = "crashed", [("traceback", _where(error))]
        native = (_text(out) + _text(err)).strip()
    checks += [("warning", shorten(str(item.message))) for item in caught if not issubclass(item.category, HARMLESS)]
    if native:
        checks.append(("words on the terminal", shorten(native)))
    if result == "accepted" and attack.verdict is REFUSE:
        checks.append(("silent acceptance", ""))
    if result == "refused" and attack.verdict is ACCEPT:
        checks.append(("refusal of what is right", ""))
    return Outcome(result, *checks[0]) if checks else Outcome(result)
