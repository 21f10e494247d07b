"""The library of LLVM is chosen by name, version and processor, without opening it."""

import struct
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from drcmitsuba.runtime import llvm_library
from drcmitsuba.runtime.llvm_library import Library

X86, ARM, X86_32 = 62, 183, 3


def elf(path, machine=X86, endian=1):
    """File with the head of a library for a processor."""
    path.parent.mkdir(parents=True, exist_ok=True)
    order = "<" if endian == 1 else ">"
    head = b"\x7fELF\x02" + bytes([endian]) + bytes(10) + struct.pack(f"{order}HH", 3, machine)
    path.write_bytes(head + bytes(44))
    return path


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Linux with Python for x86-64, whose libraries lie below a folder of the test's."""
    monkeypatch.delenv(llvm_library.VARIABLE, raising=False)
    monkeypatch.delenv("LD_LIBRARY_PATH", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(sys, "executable", str(elf(tmp_path / "bin/python")))
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "prefix"))
    monkeypatch.setattr(llvm_library, "PLACES", {"linux": (f"{tmp_path}/lib/libLLVM*.so*",)})
    monkeypatch.setattr(llvm_library, "WHEELS", ())
    return tmp_path


def wheel(folder, name, version, file):
    """Distribution that has one library."""
    library = elf(folder / "site" / file)
    info = folder / "site" / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (info / "RECORD").write_text(f"{file},,\n")
    return metadata.Distribution.at(info), library


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM.so.19.1", (19, 1)),
        ("libLLVM-15.so.1", (15,)),
        ("libLLVM-14.0.6.so.1", (14, 0, 6)),
        ("libLLVM-a6b168f6.so.21.1", (21, 1)),
        ("Cellar/llvm/21.1.6/lib/libLLVM.dylib", (21, 1, 6)),
        ("opt/llvm@18/lib/libLLVM.dylib", (18,)),
        ("LLVM/bin/LLVM-C.dll", ()),
    ],
)
def test_a_version_is_read_from_the_name(tmp_path, name, version):
    assert Library.of(tmp_path / name, "").version == version


def test_a_link_has_the_version_of_its_file(tmp_path):
    elf(tmp_path / "libLLVM.so.19.1")
    (tmp_path / "libLLVM.so").symlink_to("libLLVM.so.19.1")
    assert Library.of(tmp_path / "libLLVM.so", "").version == (19, 1)


def test_the_newest_fit_library_of_the_system_is_taken(machine):
    for name in ("libLLVM-14.so.1", "libLLVM-17.so.1", "libLLVM.so.19.1"):
        elf(machine / "lib" / name)
    elf(machine / "lib/libLLVM.so.21.1", ARM)
    (machine / "lib/libLLVM.so.22.1").write_text("INPUT(libLLVM.so.21.1)")
    found = llvm_library.find()
    assert str(found.chosen) == f"{machine}/lib/libLLVM.so.19.1, of the system"
    assert "libLLVM.so.22.1 is no library" in found.faults
    assert "libLLVM-14.so.1 is LLVM 14, and 17 or newer is needed" in found.faults
    assert "libLLVM.so.21.1 is for arm64, and this Python is for x86-64" in found.faults


@pytest.mark.parametrize("name", ["karellen-llvm-core", "llvm-nanobind"])
def test_a_wheel_helps_out_where_the_system_has_none_that_is_fit(machine, monkeypatch, name):
    found, library = wheel(machine, name, "23.1.4.post8", "x.libs/libLLVM.so.23.1")
    monkeypatch.setattr(llvm_library, "WHEELS", (name,))
    monkeypatch.setattr(metadata, "distribution", lambda _: found)
    elf(machine / "lib/libLLVM-15.so.1")
    search = llvm_library.find()
    assert search.chosen.path == library
    assert search.chosen.version == (23, 1, 4)
    assert f"of {name} 23.1.4.post8, since the system has none" in str(search.chosen)
    elf(machine / "lib/libLLVM.so.18.1")
    assert llvm_library.find().chosen.path == machine / "lib/libLLVM.so.18.1"


def test_an_environment_of_conda_helps_out(machine):
    library = elf(machine / "prefix/lib/libLLVM.so.20.1")
    assert llvm_library.find().chosen is None
    (machine / "prefix/conda-meta").mkdir()
    assert llvm_library.find().chosen.path == library


def test_the_loader_path_belongs_to_the_system(machine, monkeypatch):
    library = elf(machine / "module/libLLVM.so.18.1")
    monkeypatch.setenv("LD_LIBRARY_PATH", f":{library.parent}")
    assert str(llvm_library.find().chosen) == f"{library}, in LD_LIBRARY_PATH"


def test_the_user_has_the_first_word(machine, monkeypatch):
    elf(machine / "lib/libLLVM.so.19.1")
    mine = elf(machine / "mine/libLLVM.so.17.0")
    monkeypatch.setenv(llvm_library.VARIABLE, str(mine))
    assert llvm_library.find().chosen.path == mine
    monkeypatch.setenv(llvm_library.VARIABLE, str(machine / "none.so"))
    assert llvm_library.find().faults == f"{machine}/none.so does not exist"


@pytest.mark.parametrize(
    ("head", "kind"),
    [
        (
            b"MZ" + bytes(58) + struct.pack("<I", 64) + b"PE\0\0" + struct.pack("<H", 0xAA64),
            "arm64",
        ),
        (b"\xcf\xfa\xed\xfe" + struct.pack("<I", 0x0100000C) + bytes(60), "arm64"),
        (b"\xca\xfe\xba\xbe" + bytes(60), ""),  # for several processors
        (b"MZ", ""),
        (b"", ""),
    ],
)
def test_files_of_all_systems_tell_their_processor(tmp_path, head, kind):
    (tmp_path / "library").write_bytes(head)
    assert llvm_library.processor(tmp_path / "library") == kind


@pytest.mark.parametrize(
    ("machine_number", "kind"), [(X86_32, "32-bit x86"), (243, "processor 243")]
)
@pytest.mark.parametrize("endian", [1, 2])
def test_processors_of_other_kinds_have_names(tmp_path, machine_number, kind, endian):
    assert llvm_library.processor(elf(tmp_path / "x", machine_number, endian)) == kind


def test_this_python_and_its_library_are_of_one_kind():
    assert llvm_library.processor(Path(sys.executable)) in ("", "x86-64", "arm64")


def test_dr_jit_hears_of_the_library_before_it_is_imported(monkeypatch):
    """Also where it is imported without Mitsuba; a process that is started later inherits it."""
    monkeypatch.delenv(llvm_library.VARIABLE, raising=False)
    code = "import drcmitsuba, os; assert 'DRJIT_LIBLLVM_PATH' not in os.environ; import drjit; "
    code += "print(os.environ.get('DRJIT_LIBLLVM_PATH'))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    chosen = llvm_library.find().chosen
    assert done.stdout.strip() == str(chosen.path if chosen else None)
