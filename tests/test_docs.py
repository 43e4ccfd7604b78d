"""Documentation that cannot fall behind: links, code, and commands with flags that exist."""

import ast
import re
import shlex
from itertools import takewhile
from pathlib import Path

import pytest

from dronecombat_jax.cli import (
    commands,
    exploit,
    inventory,
    machine,
    pilots,
    play,
    rate,
    replay,
    reproduce,
    robustness,
    runs,
    tournaments,
    train,
)
from dronecombat_jax.config import flags, settings
from dronecombat_jax.config.schema import settings_of

ROOT = Path(__file__).parents[1]
PAGES = [
    *sorted((ROOT / "docs").rglob("*.md")),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "examples/README.md")),
]
FLAGS = {
    "train": train.TrainFlags,
    "evaluate": runs.EvaluateFlags,
    "export": runs.ExportFlags,
    "exploit": exploit.ExploitFlags,
    "tournament": tournaments.TournamentFlags,
    "report": tournaments.ReportFlags,
    "compare": tournaments.CompareFlags,
    "robustness": robustness.RobustnessFlags,
    "reproduce": reproduce.ReproduceFlags,
    "replay": replay.ReplayFlags,
    "play": play.PlayFlags,
    "pilots": pilots.PilotsFlags,
    "rate": rate.RateFlags,
    "runs": inventory.RunsFlags,
    "doctor": machine.DoctorFlags,
}
LINK = re.compile(r"\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```(\{?[\w-]*\}?)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?:\A|\n\n)((?: {4}[^\n]*(?:\n|\Z)|\n(?= {4}))+)")
COMMAND = re.compile(r"^(?:[^#\"']*[/\s])?dronecombat ([a-z]+\b.*)")
each_page = pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))


def prose(text: str) -> str:
    """The page without its code."""
    text = INDENTED.sub("\n\n", FENCE.sub("", text))
    return re.sub(r"`[^`\n]*`", "", text)


def anchors(page: Path) -> set[str]:
    """Of the headings of a page, as GitHub and MyST make them; a made page has its sections."""
    text = page.read_text()
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", text), re.MULTILINE)
    if "<!-- made: settings -->" in text:
        headings += settings.SECTIONS
    if "<!-- made: commands -->" in text:
        headings += commands.COMMANDS
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.strip().replace(" ", "-") for heading in plain}


def broken(page: Path, text: str) -> list[str]:
    """The relative links of `text`, as it stood on `page`, that lead nowhere."""
    wrong = []
    for link in LINK.findall(prose(text)):
        path, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:", link):
            continue
        target = page.parent / path if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            wrong.append(link)
    return wrong


@each_page
def test_every_relative_link_leads_somewhere(page):
    assert broken(page, page.read_text()) == []


def test_a_broken_link_is_noticed():
    page = ROOT / "docs" / "faq.md"
    text = "[a](nowhere.md) [b](start.md#nothing) [c](start.md#2-train) [d](#learning) [e](#x) `[f](g)`"
    assert broken(page, text) == ["nowhere.md", "start.md#nothing", "#x"]


@each_page
def test_python_compiles(page):
    for kind, body in FENCE.findall(page.read_text()):
        if kind == "python":
            compile(body, str(page), "exec")


@each_page
def test_included_code_is_there(page):
    for kind, body in FENCE.findall(page.read_text()):
        if kind != "{literalinclude}":
            continue
        opening = re.search(r"```\{literalinclude\} (\S+)\n" + re.escape(body), page.read_text())
        assert opening, body
        tree = ast.parse((page.parent / opening[1]).read_text())
        names = {node.name for node in tree.body if hasattr(node, "name")}
        for name in re.findall(r":pyobject: (\w+)", body):
            assert name in names, f"{opening[1]} has no {name}"


def command_lines(text: str) -> list[list[str]]:
    """The words after `dronecombat` in the indented and fenced blocks of a page."""
    blocks = [body for kind, body in FENCE.findall(text) if kind in ("", "bash", "sh")]
    blocks += INDENTED.findall(FENCE.sub("", text))
    joined = re.sub(r"\\\n\s*", " ", "\n".join(blocks))
    found = []
    for line in joined.splitlines():
        if match := COMMAND.match(line):
            words = shlex.split(match[1], comments=True)
            found.append(list(takewhile(lambda word: word not in ("&", "&&", "|", ";"), words)))
    return found


def mistakes(words: list[str]) -> list[str]:
    """What `dronecombat WORDS` would be refused for, of its command and the names of its flags."""
    name, *rest = words
    if name not in FLAGS:
        return [name]
    known = {settings.flag(key) for key in settings_of(FLAGS[name])} | {"--help"}
    known |= {flags._negated(key) for key in settings_of(FLAGS[name])}
    known |= set(train.SHORT_FLAGS.values()) if name == "train" else set()
    given = {word.partition("=")[0] for word in rest if word.startswith("--")}
    return sorted(given - known)


def test_the_flags_of_every_command_are_known_here():
    assert FLAGS.keys() == commands.COMMANDS.keys()


@each_page
def test_commands_and_flags_exist(page):
    for words in command_lines(page.read_text()):
        assert mistakes(words) == [], words


def test_a_wrong_command_or_flag_is_noticed():
    text = "Try:\n\n    .venv/bin/dronecombat train --presset duel  # a note\n    dronecombat fly ippo\n"
    found = command_lines(text)
    assert found == [["train", "--presset", "duel"], ["fly", "ippo"]]
    assert [mistakes(words) for words in found] == [["--presset"], ["fly"]]


def test_the_pages_hold_commands_code_and_links():
    texts = [page.read_text() for page in PAGES]
    assert sum(len(command_lines(text)) for text in texts) > 60
    assert sum(text.count("```python") for text in texts) >= 5
    assert sum(text.count("{literalinclude}") for text in texts) > 10
    assert sum(len(LINK.findall(prose(text))) for text in texts) > 60


def test_every_notebook_has_its_page():
    made = {
        path.stem: path.read_text().strip() for path in (ROOT / "docs/notebooks").glob("[0-9]*")
    }
    scripts = {path.stem for path in (ROOT / "experiments/notebooks").glob("[0-9]*.py")}
    assert made == {name: f"<!-- made: notebook {name} -->" for name in scripts}
    index = (ROOT / "docs/notebooks/index.md").read_text()
    assert all(f"\n{name}\n" in index for name in scripts)
