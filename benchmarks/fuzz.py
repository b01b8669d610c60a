"""Broken and hostile input for every reader: `make fuzz`, or

    python benchmarks/fuzz.py --inputs 100000 --readers network camera
    python benchmarks/fuzz.py --engine atheris --inputs 100000 --readers network    # pip install -e .[fuzz]

`mutate` makes inputs from valid ones: bytes, numbers, words and lines are changed, duplicated, moved or cut.
The same seed gives the same inputs. `atheris` is guided by coverage; the project's own modules are
instrumented. Findings are written to OUT/findings and printed; exit status 1 if there are any.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from benchmarks.fuzz_readers import Reader

ALL = ("scenario", "campaign", "camera", "expect", "protocol", "radar_csv", "udacity", "comma2k19")
ALL += ("network", "additional", "image_png", "image_jpg", "image_bmp", "image_tiff", "video")
OWN = ("sumo_net", "camera_synth", "plugin", "analysis")
_TOKEN = re.compile(rb"[A-Za-z_][\w.]*|-?\d+\.?\d*(?:e-?\d+)?|\s+|.", re.DOTALL)


def mutated(draw: np.random.Generator, seeds: tuple[bytes, ...], words: tuple[bytes, ...]) -> bytes:
    """A valid input with one to six changes; half have one, since more are mostly rejected early."""
    content = seeds[int(draw.integers(len(seeds)))]
    for _ in range(min(int(draw.geometric(0.5)), 6)):
        content = _CHANGES[int(draw.integers(len(_CHANGES)))](draw, content, words)
        if len(content) > 60_000:
            content = content[:60_000]
    return content


def _bytes(draw: np.random.Generator, content: bytes, words: tuple[bytes, ...]) -> bytes:
    out = bytearray(content or b"\x00")
    for _ in range(int(draw.integers(1, 5))):
        out[int(draw.integers(len(out)))] = int(draw.integers(256))
    return bytes(out)


def _token(draw: np.random.Generator, content: bytes, words: tuple[bytes, ...]) -> bytes:
    tokens = _TOKEN.findall(content) or [b""]
    chosen = words if draw.random() < 0.7 else tokens
    tokens[int(draw.integers(len(tokens)))] = chosen[int(draw.integers(len(chosen)))]
    return b"".join(tokens)


def _number(draw: np.random.Generator, content: bytes, words: tuple[bytes, ...]) -> bytes:
    found = list(re.finditer(rb"-?\d+(\.\d+)?", content))
    if not found:
        return content
    one = found[int(draw.integers(len(found)))]
    value = float(draw.choice([0, -1, 1, 0.5, 1e9, 1e-9, 1e30])) * float(draw.normal())
    text = (b"%d" % int(value)) if draw.random() < 0.3 else repr(value).encode()
    return content[: one.start()] + text + content[one.end() :]


def _lines(draw: np.random.Generator, content: bytes, words: tuple[bytes, ...]) -> bytes:
    lines = content.split(b"\n")
    at, to = int(draw.integers(len(lines))), int(draw.integers(len(lines)))
    kind = int(draw.integers(3))
    if kind == 0:
        lines.insert(to, lines[at])
    elif kind == 1:
        lines[at], lines[to] = lines[to], lines[at]
    else:
        del lines[at]
    return b"\n".join(lines)


def _cut(draw: np.random.Generator, content: bytes, words: tuple[bytes, ...]) -> bytes:
    a, b = sorted(draw.integers(0, len(content) + 1, 2).tolist())
    return content[:a] + content[b:] if draw.random() < 0.7 else content[:b]


def _insert(draw: np.random.Generator, content: bytes, words: tuple[bytes, ...]) -> bytes:
    at = int(draw.integers(len(content) + 1))
    return content[:at] + words[int(draw.integers(len(words)))] + content[at:]


_CHANGES = (_bytes, _token, _token, _number, _number, _lines, _cut, _insert)


def inputs(reader: "Reader", seed: int) -> Iterator[bytes]:
    """Endless inputs, the same for the same reader and seed. Four of five have correct checksums."""
    draw = np.random.default_rng([seed, *reader.name.encode()])
    yield from reader.seeds
    while True:
        content = mutated(draw, reader.seeds, reader.words)
        yield reader.mended(content) if draw.random() < 0.8 else content


def fuzz(name: str, count: int, seed: int, out: Path, most_s: float) -> dict[str, object]:
    """Give a reader `count` inputs, or as many as `most_s` allows; findings go to `out`."""
    from benchmarks.fuzz_readers import attempt, with_media
    from sumo_net.start_up import standard_error  # decoders write to it

    with tempfile.TemporaryDirectory(prefix="sumo-adas-fuzz-") as work, standard_error():
        folder = Path(work)
        reader = with_media(folder)[name]
        began = time.monotonic()
        done = taken = 0
        findings: dict[str, int] = {}
        for content in inputs(reader, seed):
            if done >= count or time.monotonic() - began > most_s:
                break
            outcome = attempt(reader, content, folder)
            done += 1
            taken += outcome.taken
            if outcome.finding:
                kind = re.sub(r"\d+", "N", outcome.finding)[:80]
                if kind not in findings:
                    out.mkdir(parents=True, exist_ok=True)
                    (out / f"{name}-{len(findings)}{reader.suffix}").write_bytes(content)
                    print(f"{name}: {outcome.finding[:300]}", flush=True)
                findings[kind] = findings.get(kind, 0) + 1
    return {
        "reader": name,
        "inputs": done,
        "taken": taken,
        "findings": findings,
        "seconds": round(time.monotonic() - began, 1),
    }


def guided(name: str, count: int, seed: int, out: Path, most_s: float) -> dict[str, object]:
    """The same with atheris, in a separate process, which libFuzzer ends."""
    out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    command = [
        sys.executable,
        __file__,
        "--child",
        name,
        str(out),
        "--inputs",
        str(count),
        "--seed",
        str(seed),
    ]
    done = subprocess.run([*command, "--most-s", str(most_s)], capture_output=True, text=True, check=False)
    runs = re.findall(r"Done (\d+) runs|stat::number_of_executed_units:\s*(\d+)", done.stderr)
    cover = re.findall(r"cov: (\d+)", done.stderr)
    if not runs:
        print(done.stderr[-3000:], flush=True)
    return {
        "reader": name,
        "engine": "atheris",
        "inputs": max((int(a or b) for a, b in runs), default=0),
        "coverage": int(cover[-1]) if cover else 0,
        "findings": {} if done.returncode == 0 else {f"exit {done.returncode}": 1},
        "seconds": round(time.monotonic() - began, 1),
    }


def _child(name: str, out: Path, count: int, seed: int, most_s: float) -> None:
    import atheris

    with atheris.instrument_imports(include=list(OWN)):
        from benchmarks.fuzz_readers import attempt, with_media
    with tempfile.TemporaryDirectory(prefix="sumo-adas-fuzz-") as work:
        folder, corpus = Path(work), Path(work) / "corpus"
        corpus.mkdir()
        reader = with_media(folder)[name]
        for k, content in enumerate(reader.seeds):
            (corpus / str(k)).write_bytes(content)
        quote = "\n".join(
            '"' + "".join(f"\\x{byte:02x}" for byte in word[:60]) + '"' for word in reader.words
        )
        (folder / "words").write_text(quote + "\n")

        def one(content: bytes) -> None:
            outcome = attempt(reader, content, folder)
            if outcome.finding:
                raise RuntimeError(outcome.finding)

        options = [f"-runs={count}", f"-seed={seed}", f"-dict={folder / 'words'}", "-print_final_stats=1"]
        options += [f"-max_total_time={int(most_s)}", f"-artifact_prefix={out / name}-", "-rss_limit_mb=4096"]
        atheris.Setup([sys.argv[0], *options, str(corpus)], one)
        atheris.Fuzz()


def main() -> None:
    """Fuzz the named readers, print one line each, write the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--inputs", type=int, default=100_000, help="for each reader")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most-s", type=float, default=3600.0, help="for each reader, real time")
    parser.add_argument("--readers", nargs="*", default=ALL)
    parser.add_argument("--engine", choices=("mutate", "atheris"), default="mutate")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--child", nargs=2, metavar=("READER", "OUT"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        _child(given.child[0], Path(given.child[1]), given.inputs, given.seed, given.most_s)
        return
    run = guided if given.engine == "atheris" else fuzz
    rows = []
    for name in given.readers:
        rows.append(run(name, given.inputs, given.seed, given.out / "findings", given.most_s))
        print(json.dumps(rows[-1]), flush=True)
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / f"{given.engine}.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    raise SystemExit(1 if any(row["findings"] for row in rows) else 0)


if __name__ == "__main__":
    main()
