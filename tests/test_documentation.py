"""What README and docs show works: commands, links and Python."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
import torch

from physid.cli import main
from physid.commands import COMMANDS

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
GRAVITY = 9.81
RELATIVE = 0.02  # a step of 1/240 s beside the closed form


def code(page: Path) -> list[str]:
    """Return the code of a page: fenced blocks, and blocks indented by four spaces."""
    text = page.read_text()
    fenced = re.findall(r"^```\w*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    indented = re.findall(
        r"(?:^(?: {4}.*)?\n)*(?:^ {4}.*\n)", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M
    )
    return [re.sub(r"^ {4}", "", block, flags=re.MULTILINE).strip("\n") for block in [*fenced, *indented]]


def commands(page: Path) -> list[list[str]]:
    """Return the words of every physid command in the code of a page, and in its `spans`."""
    spans = re.findall(r"`((?:\.venv/bin/)?physid [^`\n]+)`", page.read_text())
    lines = [line for block in code(page) for line in block.splitlines()] + spans
    found = [re.split(r"\s#\s", line.strip())[0].split() for line in lines]
    return [words[1:] for words in found if words and words[0].removeprefix(".venv/bin/") == "physid"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_command_that_a_page_names_exists(page: Path) -> None:
    known = {command.name: command for command in COMMANDS}
    for words in commands(page):
        if words[0] in ("COMMAND", "--help"):
            continue
        assert words[0] in known, f"physid {' '.join(words)}"
        for word in words[1:]:
            option = word.partition("=")[0].removeprefix("--").replace("-", "_")
            command = known[words[0]]
            options = {*command.options, "config", "help", *(["allow"] if command.configurable else [])}
            assert not word.startswith("--") or option in options, word
            assert not word.startswith("configs/") or (ROOT / word).exists(), word


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_to_a_file_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
        assert "://" in target or (page.parent / target).exists(), target


def test_every_message_on_the_page_of_troubles_is_one_of_the_program() -> None:
    texts = [
        node.value
        for path in (ROOT / "src").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    rows = re.findall(r"^\| `([^`]+)` \|", (ROOT / "docs" / "trouble.md").read_text(), re.MULTILINE)
    assert len(rows) > 30
    for message in rows:
        for part in [part.strip() for part in re.split(r'"?…"?', message)]:
            assert any(part in text for text in texts), f"no message of physid says: {part}"


def test_every_page_stands_in_the_index() -> None:
    index = (ROOT / "docs" / "README.md").read_text()
    for page in (ROOT / "docs").glob("*.md"):
        assert page.name == "README.md" or f"]({page.name}" in index, f"docs/README.md does not lead to {page.name}"


def test_every_link_to_a_heading_leads_to_one() -> None:
    for page in PAGES:
        for target, anchor in re.findall(r"\]\(([^)#:]*)#([^)]+)\)", page.read_text()):
            headings = re.findall(r"^#+ (.*)$", (page.parent / (target or page.name)).read_text(), re.MULTILINE)
            anchors = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
            assert anchor in anchors, f"{page.name}: {target}#{anchor}"


def test_the_python_of_the_readme_gives_the_derivative_that_it_says() -> None:
    names: dict[str, torch.Tensor] = {}
    block = next(block for block in code(ROOT / "README.md") if block.startswith("import torch"))
    try:
        exec(block, names)
    finally:
        torch.set_default_dtype(torch.float32)
    time = 60 / 240
    grad = names["friction"].grad
    assert grad is not None
    assert grad.item() == pytest.approx(-GRAVITY * time**2 / 2, rel=RELATIVE)


def test_the_first_steps_of_the_readme_identify_the_friction(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    steps = [words for words in commands(ROOT / "README.md") if words[0] in ("generate", "fit") and len(words) > 1]
    for words in steps:
        assert main([*words, *(["--workers=1", "--quiet"] if words[0] == "generate" else [])]) == 0
    assert (tmp_path / "runs" / "push_friction" / "metrics.json").exists()


def test_every_decision_stands_in_the_list_of_decisions() -> None:
    listed = (ROOT / "docs" / "decisions" / "README.md").read_text()
    for page in (ROOT / "docs" / "decisions").glob("0*.md"):
        assert f"]({page.name})" in listed, f"docs/decisions/README.md lacks {page.name}"
