"""A folder has one writer, and a dead one holds nothing."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from physid.one_writer import LOCK, FolderInUseError, one_writer, refuse_links

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


@pytest.mark.parametrize(
    ("stand", "found"),
    [(os.mkfifo, "a named pipe"), (os.mkdir, "a folder"), (lambda path: path.symlink_to("/dev/null"), "a symbolic")],
)
def test_a_lock_that_is_no_file_is_named_with_what_to_do(
    tmp_path: Path, stand: Callable[[Path], None], found: str
) -> None:
    stand(tmp_path / LOCK)
    message = rf"/\.lock: expected the file with which physid locks the folder, found {found}.*; delete it"
    with pytest.raises(OSError, match=message), one_writer(tmp_path):
        pytest.fail("locked")


def listen(path: Path) -> None:
    """Make a socket."""
    here = Path.cwd()
    os.chdir(path.parent)  # its address may have a hundred letters
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(path.name)
    os.chdir(here)


@pytest.mark.parametrize(
    ("stand", "found"),
    [
        (lambda path: path.symlink_to("/dev/null"), "a symbolic link"),
        (lambda path: path.symlink_to(path.parent), "a symbolic link"),
        (lambda path: path.symlink_to(path.parent / "nowhere"), "a symbolic link"),
        (os.mkfifo, "a named pipe"),
        (listen, "a socket"),
    ],
)
@pytest.mark.parametrize("place", ["hparams.yaml", "checkpoints/last.ckpt", "a/b/c/wandb"])
def test_nothing_is_written_where_a_link_or_a_pipe_lies(
    tmp_path: Path, stand: Callable[[Path], None], found: str, place: str
) -> None:
    (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
    stand(tmp_path / place)
    message = rf"{place}: expected nothing but files and folders where physid writes, found {found}; nothing is written"
    with pytest.raises(OSError, match=message), one_writer(tmp_path):
        pytest.fail("written")
    assert not (tmp_path / LOCK).exists()


def test_a_link_to_a_file_of_the_folder_itself_leads_nowhere_else(tmp_path: Path) -> None:
    """As Lightning makes of its last checkpoint where it is asked to."""
    (tmp_path / "run" / "mine").mkdir(parents=True)
    (tmp_path / "run" / "mine" / "epoch=1.ckpt").touch()
    (tmp_path / "run" / "mine" / "last.ckpt").symlink_to("epoch=1.ckpt")
    refuse_links(tmp_path / "run")
    with pytest.raises(OSError, match=r"last.ckpt: expected nothing but files"):
        refuse_links((tmp_path / "run" / "mine" / "epoch=1.ckpt").rename(tmp_path / "epoch=1.ckpt").parent / "run")


def test_the_named_folder_and_what_wandb_has_made_may_be_links(tmp_path: Path) -> None:
    (tmp_path / "run" / "wandb").mkdir(parents=True)
    (tmp_path / "run" / "wandb" / "latest-run").symlink_to("offline-run-1")
    (tmp_path / "run" / "file").touch()
    (tmp_path / "mine").symlink_to("run")
    with one_writer(tmp_path / "mine"):
        assert (tmp_path / "run" / LOCK).exists()
    refuse_links(tmp_path / "nowhere")
