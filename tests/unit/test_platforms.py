"""What Linux, macOS and Windows do differently, where one of them can be simulated.

Files are the same on all of them; modules and functions that only some have are asked for where
they are used; what an output cannot show is written in near signs.
"""

import ast
import ctypes
import io
import os
import sys
from contextlib import suppress
from ctypes import wintypes
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from drcmitsuba.cli import near_signs
from drcmitsuba.runtime import folder_lock, machine_memory, storage
from drcmitsuba.runtime.errors import InputError
from tests import ROOT, skips

PACKAGES = (Path(find_spec(name).origin).parent for name in ("drcmitsuba", "drcmitsuba_plugins"))
TREES = {
    path.relative_to(folder.parent).as_posix(): ast.parse(path.read_text("utf-8"))
    for folder in (*PACKAGES, ROOT / "scenes")
    for path in sorted(folder.rglob("*.py"))
}
POSIX_ALONE = {"fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "posix", "syslog"}
WINDOWS_ALONE = {"msvcrt", "winreg", "_winapi", "winsound"}
LACKING = {
    "fork", "forkpty", "killpg", "setsid", "getuid", "geteuid", "getgid", "getpgid", "sysconf",
    "sched_getaffinity", "mkfifo", "mknod", "chown", "nice", "statvfs", "uname", "posix_fallocate",
    "pthread_sigmask", "pthread_kill", "alarm", "setitimer", "pause", "SIGALRM", "SIGKILL",
    "SIGHUP", "SIGUSR1",
}  # fmt: skip
"""Names of `os` and `signal` that Windows lacks."""
HANDLED = {
    ("drcmitsuba/runtime/machine_memory.py", "sysconf"),
    ("drcmitsuba/runtime/storage.py", "posix_fallocate"),
    ("drcmitsuba/runtime/interruption.py", "pthread_sigmask"),
    ("drcmitsuba/runtime/interruption.py", "pthread_kill"),
}
"""Where a system without them is asked for first."""


def calls(tree, *names):
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", None))
            if name in names:
                yield node


def at_top(tree):
    """Modules that are imported together with one."""
    for node in tree.body:
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]


def test_modules_of_some_systems_are_imported_where_they_are_used():
    wrong = {
        name: found
        for name, tree in TREES.items()
        if (found := (POSIX_ALONE | WINDOWS_ALONE) & {*at_top(tree)})
    }
    assert wrong == {}


def test_functions_that_windows_lacks_are_asked_for():
    used = {
        (name, node.attr)
        for name, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id in ("os", "signal")
        and node.attr in LACKING
    }
    assert used == HANDLED


def is_binary(call):
    texts = [node.value for node in ast.walk(call) if isinstance(node, ast.Constant)]
    return any(isinstance(text, str) and text in ("rb", "wb", "ab", "xb", "r+b") for text in texts)


def test_text_files_have_an_encoding_of_their_own():
    """Windows would read and write them in the encoding of the country."""
    bare = []
    for name, tree in TREES.items():
        for call in calls(tree, "open", "read_text", "write_text", "fdopen", "TextIOWrapper"):
            words = ast.unparse(call)
            is_path = isinstance(call.func, ast.Attribute) or call.func.id in ("open", "fdopen")
            if is_path and "utf-8" not in words and "ascii" not in words and not is_binary(call):
                bare.append(f"{name}:{call.lineno}: {words}")
    others = ("ifcopenshell.open", "Image.open", "read_text(path)")  # their own readers
    assert [line for line in bare if not any(other in line for other in others)] == []


def test_lines_end_alike_on_all_systems(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "linesep", "\r\n")
    storage.save_csv(pd.DataFrame({"a": [1, 2]}), tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_bytes() == b"a\n1\n2\n"
    storage.save_lines(["E ≤ 3\n", "b\n"], tmp_path / "b.txt")
    assert (tmp_path / "b.txt").read_bytes() == "E ≤ 3\nb\n".encode()


# ---- outputs of other encodings ------------------------------------------------------------------


def words_of(tree):
    """Strings of a module that are no docstrings."""
    told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in told:
            yield node.value


def test_every_sign_of_the_messages_has_a_near_one():
    signs = {sign for tree in TREES.values() for words in words_of(tree) for sign in words}
    lost = {sign for sign in signs if not sign.isascii() and near_signs.near(sign)[0] == "\\"}
    assert lost == set()


@pytest.mark.parametrize(
    ("encoding", "written"),
    [
        ("utf-8", "Façade 2.0 ≤ 3 ± 1 … −5°"),
        ("cp1252", "Façade 2.0 <= 3 ± 1 … -5°"),
        ("ascii", "Facade 2.0 <= 3 +/- 1 ... -5 deg"),
    ],
)
def test_what_an_output_lacks_is_written_in_near_signs(encoding, written):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding, newline="")
    near_signs.allow(stream)
    print("Façade 2.0 ≤ 3 ± 1 … −5°", end="", file=stream, flush=True)
    assert raw.getvalue().decode(encoding) == written


def test_a_sign_without_a_near_one_is_written_by_its_number():
    assert near_signs.near("中") == "\\u4e2d"
    near_signs.allow(io.StringIO(), SimpleNamespace())  # those of a notebook, or of a window


# ---- a folder of one process on Windows ----------------------------------------------------------


@pytest.fixture
def windows(monkeypatch):
    """A lock of bytes, and files that cannot be removed while they are open; the locks' places."""
    taken = []

    def locking(descriptor, mode, count):
        if taken and taken[-1] == "another":
            raise PermissionError(13, "Permission denied")
        taken.append((os.lseek(descriptor, 0, os.SEEK_CUR), mode, count))

    opened, unlink, open_ = [], Path.unlink, Path.open

    def remove(path, **options):
        if any(not file.closed for file in opened if Path(file.name) == path):
            raise PermissionError(13, "being used by another process", str(path))
        unlink(path, **options)

    def kept(path, *arguments, **options):
        opened.append(open_(path, *arguments, **options))
        return opened[-1]

    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(locking=locking, LK_NBLCK=2))
    monkeypatch.setattr(folder_lock, "sys", SimpleNamespace(platform="win32"))
    monkeypatch.setattr(folder_lock, "CLOSED_FIRST", True)
    monkeypatch.setattr(Path, "unlink", remove)
    monkeypatch.setattr(Path, "open", kept)
    return taken


def test_a_lock_of_windows_leaves_no_file(windows, tmp_path):
    for _ in range(2):
        with folder_lock.locked(tmp_path / "new"):
            assert (tmp_path / "new" / ".lock").read_text() == f"{os.getpid()}\n"
        assert not (tmp_path / "new").exists()
    with suppress(ValueError), folder_lock.locked(tmp_path):
        raise ValueError
    assert list(tmp_path.iterdir()) == []
    assert windows == [(1 << 30, 2, 1)] * 3


def test_a_lock_that_another_holds_on_windows_is_refused(windows, tmp_path):
    (tmp_path / ".lock").write_text("4711\n")
    windows.append("another")
    with pytest.raises(InputError, match="process 4711"), folder_lock.locked(tmp_path):
        pytest.fail("two hold it")
    assert (tmp_path / ".lock").exists()


# ---- memory -------------------------------------------------------------------------------------


def test_memory_is_read_where_there_is_no_proc(monkeypatch, tmp_path):
    resource = pytest.importorskip("resource", reason=skips.POSIX.words)
    monkeypatch.setattr(machine_memory, "STATUS", tmp_path / "none")
    taken = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    monkeypatch.setattr(machine_memory, "sys", SimpleNamespace(platform="linux"))
    assert machine_memory.peak_memory() == pytest.approx(1024 * taken, rel=0.01)
    monkeypatch.setattr(machine_memory, "sys", SimpleNamespace(platform="darwin"))
    assert machine_memory.peak_memory() == pytest.approx(taken, rel=0.01)


@pytest.mark.parametrize("text", ["1048576\n", "max\n"])
def test_the_limit_of_a_container_bounds_the_memory(monkeypatch, tmp_path, text):
    pytest.importorskip("resource", reason=skips.POSIX.words)
    (tmp_path / "memory.max").write_text(text)
    monkeypatch.setattr(machine_memory, "LIMITS", [tmp_path / "none", tmp_path])
    whole = machine_memory.of_machine()  # neither file can be read
    monkeypatch.setattr(machine_memory, "LIMITS", [tmp_path / "none", tmp_path / "memory.max"])
    expected = machine_memory.SHARE * (1 << 20) if text[0] == "1" else whole
    assert machine_memory.of_machine() == expected < float("inf")


def test_memory_of_windows_is_the_largest_working_set(monkeypatch, tmp_path):
    """The third of the ten numbers, after two of 32 bit and before seven of machine size."""

    class Function:
        restype = argtypes = None

        def __call__(self, process, counters, size):
            head = 2 * ctypes.sizeof(wintypes.DWORD)
            assert size == head + 8 * ctypes.sizeof(ctypes.c_size_t)
            numbers = (ctypes.c_size_t * 8).from_address(ctypes.addressof(counters._obj) + head)
            numbers[0], numbers[1] = 5 << 30, 7
            return 1

    kernel = SimpleNamespace(
        K32GetProcessMemoryInfo=Function(), GetCurrentProcess=lambda: wintypes.HANDLE(-1)
    )
    monkeypatch.setattr(ctypes, "WinDLL", lambda name: kernel, raising=False)
    monkeypatch.setattr(machine_memory, "sys", SimpleNamespace(platform="win32"))
    monkeypatch.setattr(machine_memory, "STATUS", tmp_path / "none")
    assert machine_memory.peak_memory() == 5 << 30
