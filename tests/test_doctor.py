"""The choice of an LLVM, mostly in processes of their own: Dr.Jit makes its choice only once."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fresnel_decomp import doctor
from fresnel_decomp._check import InputError
from fresnel_decomp._llvm import choice, fetch, search

RUN_KERNEL = "import drjit as dr; from drjit.llvm import Float; x = dr.maximum(Float([1, -2]), 0)"


def python(code: str, *, cache: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run `code` in a new interpreter without the choice that this process has made."""
    for folder in search.cache_folder().glob("lib-*"):  # without which Mitsuba does not import here
        if folder.parent != cache:
            with contextlib.suppress(FileExistsError):
                (cache / folder.name).symlink_to(folder)
    settings = {k: v for k, v in os.environ.items() if not k.startswith(("DRJIT_", "FRESNEL_"))}
    settings |= {"FRESNEL_DECOMP_CACHE": str(cache), "PYTHONWARNINGS": "error", **environment}
    return subprocess.run(
        [sys.executable, "-c", code],
        env=settings, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


def usable_library() -> search.Library:
    """Return an LLVM that works here, or skip."""
    library, reasons = search.find()
    if library is None:
        pytest.skip(f"no usable LLVM: {'; '.join(reasons) or 'none found'}")
    return library


def old_library() -> Path:
    """Return an LLVM that is too old for Dr.Jit, or skip."""
    for path in search.candidates():
        if (version := search.version_in_name(path)) and version[0] in (15, 16):
            return path
    pytest.skip("this machine has no LLVM 15 or 16")


@pytest.fixture
def clean(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An empty cache folder, no variable set, nothing decided, and Dr.Jit as if not imported."""
    monkeypatch.setenv("FRESNEL_DECOMP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv(search.VARIABLE, "")
    monkeypatch.delenv("FRESNEL_DECOMP_LLVM", raising=False)
    monkeypatch.setattr(choice, "_decided", None)
    monkeypatch.delitem(sys.modules, "drjit", raising=False)
    monkeypatch.setattr(search, "import_error", lambda: "")
    return tmp_path


def put(folder: Path, name: str, *, size: int = 3) -> Path:
    """Write a file that is no library."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_bytes(b"x" * size)
    return path


def copy_in_cache(version: str = "19.1.7", *, needed: tuple[str, ...] = ()) -> Path:
    """Pretend that `fix` had run."""
    folder = search.cache_folder() / f"llvm-{version}"
    path = put(folder / "lib", f"libLLVM.so.{version}")
    for name in needed:
        put(folder / "lib", name)
    entry = {
        "library": f"lib/{path.name}",
        "preload": [f"lib/{name}" for name in needed],
        "version": [int(part) for part in version.split(".")],
    }
    (folder / "manifest.json").write_text(json.dumps(entry))
    return path


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM-15.so.1", (15,)),
        ("libLLVM-14.0.6.so.1", (14, 0, 6)),
        ("libLLVM-17.so", (17,)),
        ("libLLVM.so.19.1", (19, 1)),
        ("libLLVM.so.20.1", (20, 1)),
        ("libLLVM.so", None),
        ("Cellar/llvm/20.1.3/lib/libLLVM.dylib", (20, 1, 3)),
        ("Cellar/llvm@18/18.1.8/lib/libLLVM.dylib", (18, 1, 8)),
        ("libLLVM.so.22.1-rust-1.95.0-stable", None),
        ("LLVM-C.dll", None),
    ],
)
def test_version_in_name(name: str, version: tuple[int, ...] | None, tmp_path: Path) -> None:
    assert search.version_in_name(tmp_path / name) == version


def test_version_in_name_follows_links(tmp_path: Path) -> None:
    put(tmp_path, "libLLVM.so.18.1")
    (tmp_path / "libLLVM.so").symlink_to("libLLVM.so.18.1")
    assert search.version_in_name(tmp_path / "libLLVM.so") == (18, 1)


@pytest.mark.parametrize("colour", ["rgb", "spectral"])
def test_best_variant_works(colour: str) -> None:
    name = doctor.best_variant(colour)
    assert name.endswith(f"_{colour}")
    assert doctor.require_variant(name) is None


def test_best_variant_of_an_unknown_colour() -> None:
    with pytest.raises(InputError, match=r"colour='rbg' is unknown.*accepted.*Did you mean 'rgb'"):
        doctor.best_variant("rbg")


def test_scalar_always_works() -> None:
    variants = doctor.usable_variants()
    assert all(v.usable for name, v in variants.items() if name.startswith("scalar"))
    assert all(v.usable or (v.reason and v.remedy) for v in variants.values())


def test_require_variant_not_in_the_wheel() -> None:
    message = r"variant='llvm_ad_rbg' is unknown; accepted: .*Did you mean 'llvm_ad_rgb'"
    with pytest.raises(InputError, match=message):
        doctor.require_variant("llvm_ad_rbg")


def test_report_names_everything() -> None:
    result = doctor.report()
    text = doctor.format_report(result)
    for part in (*result.versions, *result.variants, result.best, "LLVM"):
        assert part in text
    for variant in result.variants.values():
        assert variant.reason in text
        assert variant.remedy in text


def test_report_without_mitsuba(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise ImportError("no such luck")

    monkeypatch.setattr(doctor, "usable_variants", broken)
    assert "no such luck" in doctor.format_report(doctor.report())


# A process without an LLVM must neither abort nor fall back to one that aborts.

WITHOUT = [
    pytest.param({"FRESNEL_DECOMP_LLVM": "off"}, "switched off", id="off"),
    pytest.param({"DRJIT_LIBLLVM_PATH": "/nowhere/libLLVM.so"}, "is not a file", id="missing"),
    pytest.param({"DRJIT_LIBLLVM_PATH": __file__}, "cannot be loaded as LLVM", id="no-library"),
    pytest.param({"DRJIT_LIBLLVM_PATH": "libc.so.6"}, "cannot be loaded as LLVM", id="not-LLVM"),
]
HIDE_SYSTEM = "from fresnel_decomp._llvm import search; search.candidates = lambda: []; "


@pytest.mark.parametrize(("environment", "reason"), WITHOUT)
def test_without_llvm(environment: dict[str, str], reason: str, tmp_path: Path) -> None:
    code = HIDE_SYSTEM + (
        "from fresnel_decomp import doctor; llvm = doctor.prepare(); assert not llvm.usable; "
        "import json, sys; v = doctor.usable_variants(); best = doctor.best_variant();"
        "print(json.dumps([llvm.reason, v['llvm_ad_rgb'].usable, v['llvm_ad_rgb'].reason, best]));"
        "import mitsuba as mi; mi.set_variant('scalar_rgb'); assert mi.Float(1) == 1\n"
        "try: mi.set_variant('llvm_ad_rgb')\n"
        "except ImportError: sys.exit(7)"
    )
    done = python(code, cache=tmp_path, **environment)
    assert done.returncode == 7, done.stderr
    before, usable, after, best = json.loads(done.stdout)
    assert reason in before
    assert before == after
    assert not usable
    assert best in ("scalar_rgb", "cuda_ad_rgb")
    assert done.stderr == ""


def test_require_variant_without_llvm(tmp_path: Path) -> None:
    code = HIDE_SYSTEM + "from fresnel_decomp import doctor; doctor.require_variant('llvm_ad_rgb')"
    done = python(code, cache=tmp_path)
    assert done.returncode == 1
    given, accepted = done.stderr.split("; accepted: ")
    assert "variant 'llvm_ad_rgb' cannot run here: no LLVM was found" in given
    assert accepted.startswith("'scalar_rgb', ")
    assert "Run: " in accepted


def test_llvm_15_is_refused_before_any_kernel(tmp_path: Path) -> None:
    old = old_library()
    code = f"""
import os
os.environ["DRJIT_LIBLLVM_PATH"] = {str(old)!r}
from fresnel_decomp import doctor
from fresnel_decomp._llvm import search
search.candidates = lambda: [{str(old)!r}]
print(doctor.prepare().reason)
doctor.require_variant("llvm_ad_rgb")
"""
    done = python(code, cache=tmp_path)
    assert done.returncode == 1  # an exception; an abort would be negative
    assert str(old) in done.stdout
    assert "older than 17" in done.stdout
    assert "InputError: variant 'llvm_ad_rgb' cannot run here" in done.stderr


def test_too_late_for_a_choice(tmp_path: Path) -> None:
    code = (
        "import drjit; from fresnel_decomp import doctor; llvm = doctor.prepare();"
        "assert not llvm.usable; print(llvm.reason, '|', llvm.remedy);"
        "doctor.require_variant('llvm_ad_rgb')"
    )
    done = python(code, cache=tmp_path, DRJIT_LIBLLVM_PATH=str(old_library()))
    assert done.returncode == 1
    assert "imported before prepare() and has taken LLVM 15" in done.stdout
    assert "before `import mitsuba`" in done.stdout
    assert "InputError" in done.stderr


def test_an_llvm_that_dr_jit_found_by_itself(tmp_path: Path) -> None:
    library = usable_library()
    code = "import drjit; from fresnel_decomp import doctor; assert doctor.prepare().usable"
    if library.preload:
        pytest.skip("the only usable LLVM needs prepare()")
    done = python(code, cache=tmp_path, DRJIT_LIBLLVM_PATH=str(library.path))
    assert done.returncode == 0, done.stderr


def test_prepare_makes_a_render_possible(tmp_path: Path) -> None:
    usable_library()
    code = """
from fresnel_decomp import doctor
assert doctor.prepare().usable
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
scene = mi.load_dict({"type": "scene", "shape": {"type": "sphere"},
    "light": {"type": "constant"}, "integrator": {"type": "path"},
    "sensor": {"type": "perspective", "to_world": mi.ScalarTransform4f().look_at(
        origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 8, "height": 8}}})
print(float(mi.TensorXf(mi.render(scene, spp=4)).array[0]))
"""
    done = python(code, cache=search.cache_folder())
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) == pytest.approx(1, abs=1e-5)


def test_prepare_is_quick() -> None:
    usable_library()
    code = (
        "import time; from fresnel_decomp import doctor; doctor.prepare(); t = time.perf_counter();"
        "assert doctor.prepare().usable; print(time.perf_counter() - t)"
    )
    done = python(code, cache=search.cache_folder())
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 0.05


# The rules of the choice, with stand-ins for the files.


def test_our_copy_is_found(clean: Path) -> None:
    path = copy_in_cache()
    copy_in_cache("18.1.8")
    llvm = doctor.prepare()
    assert (llvm.usable, llvm.path, llvm.version) == (True, path, (19, 1, 7))
    assert os.environ[search.VARIABLE] == str(path)


def test_a_child_process_recognises_our_copy(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[Path] = []
    monkeypatch.setattr(search, "preload", loaded.extend)
    path = copy_in_cache(needed=("libz3.so.4",))
    monkeypatch.setenv(search.VARIABLE, str(path))  # as a parent process leaves it
    assert doctor.prepare().usable
    assert [p.name for p in loaded] == ["libz3.so.4"]


def test_a_needed_library_that_does_not_load(clean: Path) -> None:
    copy_in_cache(needed=("libz3.so.4",))
    llvm = doctor.prepare()
    assert not llvm.usable
    assert "needs a library that does not load" in llvm.reason
    assert "doctor --fix" in llvm.remedy


def test_damaged_copies_are_passed_over(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "candidates", list)
    copy_in_cache("20.1.0").unlink()
    (copy_in_cache("18.1.0").parents[1] / "manifest.json").write_text("{")
    copy_in_cache("16.0.6")
    assert not doctor.prepare().usable
    path = copy_in_cache("17.0.6")
    assert doctor.prepare().path == path


def test_the_users_choice_comes_first(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy_in_cache()
    mine = put(clean, "libLLVM.so.18.1")
    monkeypatch.setattr(search, "_probe", lambda text: ((18, 1, 0), ""))
    monkeypatch.setenv(search.VARIABLE, str(mine))
    assert doctor.prepare().path == mine


def test_an_unusable_choice_is_replaced_with_a_warning(
    clean: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    path = copy_in_cache()
    monkeypatch.setenv(search.VARIABLE, str(put(clean, "libLLVM-15.so.1")))
    assert doctor.prepare().path == path
    assert "older than 17" in caplog.text
    assert f"using '{path}' instead" in caplog.text


def test_nothing_usable_hides_what_would_abort(
    clean: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "candidates", lambda: [put(clean, "libLLVM-16.so.1")])
    llvm = doctor.prepare()
    assert not llvm.usable
    assert "LLVM 16" in llvm.reason
    assert not Path(os.environ[search.VARIABLE]).exists()
    assert doctor.prepare() == llvm  # our own setting is not mistaken for the user's


def test_the_highest_version_of_the_system(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("libLLVM-15.so.1", "libLLVM.so.18.1", "libLLVM.so.20.1"):
        put(clean, name)
    monkeypatch.setenv("LD_LIBRARY_PATH", str(clean))
    ours = [p.name for p in search.candidates() if p.parent == clean]
    assert ours == ["libLLVM.so.20.1", "libLLVM.so.18.1", "libLLVM-15.so.1"]


def test_a_probe_is_remembered_until_the_file_changes(
    clean: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def answer(code: str, arguments: list[str], timeout: float) -> tuple[str, str]:
        asked.append(arguments)
        return "[19, 1, 7]", ""

    monkeypatch.setattr(search, "_python", answer)
    path = put(clean, "libLLVM.so")
    for _ in range(3):
        assert search.examine(path)[0] == search.Library(path, (19, 1, 7))
    assert len(asked) == 1
    put(clean, "libLLVM.so", size=4)
    assert search.examine(path)[0]
    assert len(asked) == 2


# Getting one.


def fake_tools(folder: Path, script: str) -> None:
    for name in ("apt-get", "apt-cache", "dpkg-deb"):
        tool = put(folder, name)
        tool.write_text(f"#!/bin/sh\n{script}\n")
        tool.chmod(0o755)


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-ins are shell scripts")
def test_fix_with_a_package_manager_that_fails(
    clean: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "candidates", list)
    fake_tools(clean / "bin", "echo 'E: Temporary failure resolving' >&2; exit 100")
    monkeypatch.setenv("PATH", f"{clean / 'bin'}:/usr/bin:/bin")
    steps: list[str] = []
    llvm = doctor.fix(steps.append)
    assert not llvm.usable
    assert "fetching one failed: E: Temporary failure resolving" in llvm.reason
    assert llvm.remedy.startswith("Run: ")
    assert steps == ["reading the distribution's package lists"]
    assert list((clean / "cache").iterdir()) == []  # nothing half-written


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-ins are shell scripts")
def test_fix_with_a_package_that_holds_nothing(
    clean: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "candidates", list)
    offer = r"printf 'libllvm19:\n  Installed: (none)\n  Candidate: 1:19.1.7\n'"
    fake_tools(clean / "bin", f"case $* in *policy*) {offer};; *download*) touch a.deb;; esac")
    monkeypatch.setenv("PATH", f"{clean / 'bin'}:/usr/bin:/bin")
    llvm = doctor.fix()
    assert not llvm.usable
    assert "libllvm19: the package holds no libLLVM" in llvm.reason
    assert list((clean / "cache").iterdir()) == []


def test_fix_without_a_package_manager(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "candidates", list)
    monkeypatch.setenv("PATH", str(clean))
    monkeypatch.delenv("CONDA_PREFIX", raising=False)
    llvm = doctor.fix()
    assert not llvm.usable
    assert llvm.remedy.startswith("Run: install LLVM 17 or newer")
    put(clean, "dnf").chmod(0o755)
    assert doctor.fix().remedy == "Run: sudo dnf install llvm-libs"


def test_fix_into_a_folder_that_cannot_be_made(
    clean: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "candidates", list)
    monkeypatch.setattr(fetch, "can_fetch", lambda: True)
    monkeypatch.setenv("FRESNEL_DECOMP_CACHE", str(put(clean, "file") / "cache"))
    assert "FRESNEL_DECOMP_CACHE can name another folder" in doctor.fix().reason


def test_fix_replaces_a_copy_whose_kernels_fail(
    clean: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = copy_in_cache()
    monkeypatch.setattr(fetch, "can_fetch", lambda: True)
    better = search.Library(clean / "libLLVM.so.20.1", (20, 1))
    monkeypatch.setattr(fetch, "fetch_llvm", lambda progress: better)
    steps: list[str] = []
    assert doctor.fix(steps.append).path == better.path
    assert str(broken) in steps[0]


def test_fix_does_nothing_where_llvm_works(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = copy_in_cache()
    monkeypatch.setattr(search, "run_kernel", lambda library: "")
    monkeypatch.setattr(fetch, "fetch_llvm", lambda progress: pytest.fail("fetched"))
    assert doctor.fix().path == path
    assert doctor.prepare(download=True).path == path


def test_fix_when_it_is_too_late(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Without:
        class JitBackend:
            LLVM = 2

        class detail:  # noqa: N801
            llvm_version = staticmethod(lambda: (-1, -1, -1))

        has_backend = staticmethod(lambda backend: False)

    copy_in_cache()
    monkeypatch.setattr(search, "run_kernel", lambda library: "")
    monkeypatch.setitem(sys.modules, "drjit", Without)
    llvm = doctor.fix()
    assert not llvm.usable
    assert "LLVM 19.1.7 is ready" in llvm.reason
    assert llvm.remedy == "Start Python again"


def test_run_kernel_reports_an_abort_of_the_child() -> None:
    library = search.Library(old_library(), (15,))
    started = time.perf_counter()
    assert "took another LLVM: 15" in search.run_kernel(library)
    assert time.perf_counter() - started < 60


def test_run_kernel_with_a_library_that_works() -> None:
    assert search.run_kernel(usable_library()) == ""


# A system library without which Mitsuba does not even import, such as libatomic on a bare Debian.

LACKING = "libatomic.so.1: cannot open shared object file"


@pytest.mark.parametrize(
    ("library", "package"),
    [
        ("libatomic.so.1", "libatomic1"),
        ("libGL.so.1", "libgl1"),
        ("libz3.so.4", "libz3-4"),
        ("libstdc++.so.6", "libstdc++6"),
    ],
)
def test_package_of(library: str, package: str) -> None:
    assert fetch.package_of(library) == package


def test_fix_fetches_a_lacking_library(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fetched: list[str] = []
    copy_in_cache()
    monkeypatch.setattr(search, "import_error", lambda: "" if fetched else LACKING)
    monkeypatch.setattr(search, "run_kernel", lambda library: "")
    monkeypatch.setattr(fetch, "can_fetch", lambda: True)
    monkeypatch.setattr(fetch, "fetch_library", lambda name, _: fetched.append(name))
    assert doctor.fix().usable
    assert fetched == ["libatomic.so.1"]


def test_fix_tries_a_lacking_library_once(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fetched: list[str] = []
    monkeypatch.setattr(search, "import_error", lambda: LACKING)
    monkeypatch.setattr(fetch, "can_fetch", lambda: True)
    monkeypatch.setattr(fetch, "fetch_library", lambda name, _: fetched.append(name))
    llvm = doctor.fix()
    assert fetched == ["libatomic.so.1"]
    assert llvm.reason == "Mitsuba does not import: this system lacks libatomic.so.1"
    assert "sudo apt-get install libatomic1" in llvm.remedy


def test_a_damaged_install_is_reported(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "import_error", lambda: "ImportError: nothing to see")
    llvm = doctor.fix()
    assert llvm.reason == "Mitsuba does not import: ImportError: nothing to see"


def test_a_lacking_library_is_named_by_the_import(tmp_path: Path) -> None:
    (tmp_path / "drjit.py").write_text(
        f"try:\n    raise ImportError({LACKING!r})\nexcept ImportError:\n    _drjit_ext.__file__\n"
    )  # as Dr.Jit does
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from fresnel_decomp import doctor;"
        "print(doctor.format_report(doctor.report())); doctor.usable_variants()"
    )
    done = python(code, cache=tmp_path)
    message = "Mitsuba does not import: this system lacks libatomic.so.1. "
    assert message in done.stdout
    assert f"\nImportError: {message}" in done.stderr


@pytest.mark.slow
@pytest.mark.skipif(not fetch.can_fetch(), reason="needs apt-get and dpkg-deb")
def test_fix_really_fetches(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    cache.mkdir()
    code = (
        f"{HIDE_SYSTEM} from fresnel_decomp import doctor; llvm = doctor.fix(print); print(llvm);"
        f"assert llvm.usable, llvm.reason; doctor.require_variant('llvm_ad_rgb'); {RUN_KERNEL};"
        "assert list(x) == [1, 0]"
    )
    done = python(code, cache=cache)
    if "fetching one failed" in done.stderr and "package" not in done.stderr:
        pytest.skip(f"no network: {done.stderr[-300:]}")
    assert done.returncode == 0, done.stdout + done.stderr
    assert [p.name[:5] for p in cache.iterdir() if not p.name.startswith("lib-")] == ["llvm-"]
    again = python(f"{HIDE_SYSTEM} from fresnel_decomp import doctor; doctor.prepare(); "
                   f"{RUN_KERNEL}", cache=cache)  # fmt: skip
    assert again.returncode == 0, again.stderr
