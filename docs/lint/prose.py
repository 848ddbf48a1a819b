"""A prose linter: long sentences and banned words in Markdown. prose.py FILE... ends with 1 if it finds any.

Only `.`, `?` and `!` end a sentence, not `;` or `:`. A list item and a cell of a table are prose of their own. Blocks of
code, headings and link targets are not prose. What a generator writes is checked all the same.
"""

import re
import sys
from pathlib import Path

MOST_WORDS = 35
FOLDER = Path(__file__).parent
IGNORED = re.compile(r"^(\||#|\s{4}|<!--|!\[)")


def words_banned():
    """Pattern and advice of each line of banned.txt."""
    for line in (FOLDER / "banned.txt").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            pattern, advice = line.split("\t")
            yield re.compile(rf"\b(?:{pattern})\b", re.IGNORECASE), advice


def paragraphs(text):
    """Line number and text of each paragraph, list item and cell of a table."""
    kept, first, is_code = [], 0, False
    for number, line in enumerate([*text.splitlines(), ""], start=1):
        if line.lstrip().startswith("```"):
            is_code = not is_code
        is_item = re.match(r"\s*([-*]|\d+\.) ", line)
        ends = is_code or not line.strip() or IGNORED.match(line) or line.lstrip().startswith("```") or is_item
        if ends and kept:
            yield first, " ".join(kept)
            kept = []
        if line.startswith("|") and not is_code:
            yield from ((number, cell.strip()) for cell in re.split(r"(?<!\\)\|", line))
        if is_code or not line.strip() or line.lstrip().startswith("```") or (IGNORED.match(line) and not is_item):
            continue
        if not kept:
            first = number
        kept.append(re.sub(r"^\s*([-*]|\d+\.) ", "", line).strip())


def plain(text):
    """Prose alone: a link by its text, a piece of code as one word."""
    text = re.sub(r"`[^`]*`", "code", text)
    text = re.sub(r"!?\[([^]]*)\]\([^)]*\)", r"\1", text)
    return re.sub(r"\b(e\.g|i\.e|et al|cf|Eq|Fig|vs)\.", r"\1", text)


def sentences(text):
    return [one for one in re.split(r"(?<=[.!?])\s+", text) if one]


def faults(path, banned):
    for line, text in paragraphs(path.read_text(encoding="utf-8")):
        for sentence in sentences(plain(text)):
            count = len(sentence.split())
            if count > MOST_WORDS:
                yield line, f"{count} words, more than {MOST_WORDS}: {sentence[:60]}..."
            for pattern, advice in banned:
                if found := pattern.search(sentence):
                    yield line, f"'{found.group()}': {advice}"


def main():
    banned = list(words_banned())
    found = [(path, line, said) for path in map(Path, sys.argv[1:]) for line, said in faults(path, banned)]
    for path, line, said in found:
        print(f"{path}:{line}: {said}")
    return min(len(found), 1)


sys.exit(main())
