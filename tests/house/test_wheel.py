"""What is built works without the checkout: the wheel, installed elsewhere, runs a graph from its own data files; the
source archive has the pages that README and tests name."""

import json
import os
import subprocess
import sys
import tarfile
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.timeout(900)
def test_wheel_runs_elsewhere(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--outdir", str(tmp_path), str(ROOT)],
        check=True,
        capture_output=True,
        text=True,
    )
    (wheel,) = tmp_path.glob("*.whl")
    home = tmp_path / "elsewhere"
    venv.create(home)
    python = home / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-compile", "--quiet"]
    subprocess.run([*install, "--disable-pip-version-check", wheel], check=True, capture_output=True, text=True)
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    result = subprocess.run(
        [str(home / "bin" / "evis"), "launch", "spinning_disk", "--duration", "0.1", "--no-view", "--json"],
        cwd=home,
        env=env,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout.strip().splitlines()[-1])
    assert summary["events"] > 0
    assert summary["keyframes"] == 4  # 0, 33.3, 66.7 and 100 ms
    code = "import evis, os; print(evis.__file__, evis.__version__, os.path.dirname(evis.__file__) + '/py.typed')"
    where = subprocess.run([str(python), "-c", code], cwd=home, env=env, capture_output=True, text=True)
    file, version, typed = where.stdout.split()
    assert str(home) in file and version in wheel.name and Path(typed).is_file()


def test_the_source_archive_has_the_pages(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "build", "--sdist", "--outdir", str(tmp_path), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True, text=True)
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        names = {name.partition("/")[2] for name in tar.getnames()}
    kept = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "docs").rglob("*")
        if path.suffix in (".md", ".json", ".png")
    }
    assert kept and kept <= names
