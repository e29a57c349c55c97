"""A folder has one writer, and a dead one holds nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from physid.one_writer import LOCK, FolderInUseError, one_writer

HOLD = (
    "import sys, time; from pathlib import Path; from physid.one_writer import one_writer\n"
    "with one_writer(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
)


def test_the_second_writer_is_told_which_process_is_the_first(tmp_path: Path) -> None:
    with one_writer(tmp_path / "run"):
        message = rf"run is being written by process {os.getpid()} on .*; wait until"
        with pytest.raises(FolderInUseError, match=message), one_writer(tmp_path / "run"):
            pytest.fail("two writers")
        with one_writer(tmp_path / "other"):
            pass
    with one_writer(tmp_path / "run"):
        pass
    assert not (tmp_path / "run" / LOCK).exists()


def test_a_process_that_was_killed_holds_no_lock(tmp_path: Path) -> None:
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with pytest.raises(FolderInUseError, match=f"process {holder.pid} "), one_writer(tmp_path):
        pytest.fail("two writers")
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    holder.stdout.close()
    assert (tmp_path / LOCK).exists()
    with one_writer(tmp_path):
        pass


def test_of_many_at_once_one_gets_the_folder_at_any_time(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from physid.one_writer import FolderInUseError, one_writer\n"
        "place, end = Path(sys.argv[1]), time.monotonic() + 1.5\n"
        "while time.monotonic() < end:\n"
        "    try:\n"
        "        with one_writer(place):\n"
        "            (place / 'mine').touch(exist_ok=False); (place / 'mine').unlink()\n"
        "    except FolderInUseError: pass\n"
    )
    started = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path)]) for _ in range(3)]
    assert [one.wait() for one in started] == [0, 0, 0]


def test_a_lock_that_leads_elsewhere_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").write_text("precious")
    (tmp_path / LOCK).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="symbolic"), one_writer(tmp_path):
        pytest.fail("followed")
    assert (tmp_path / "elsewhere").read_text() == "precious"
