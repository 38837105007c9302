#!/usr/bin/env python3
"""Races this crate against its peers on the same clouds in the same run.

    python3 cech-complex/benches/race/race.py [--sizes 2000 8000] [--repeats 3]

Clouds are ε-nets of a sphere, a torus and a genus-2 surface, written by the example `nets`. Every method builds its complex at the same
scale (discs and balls of 1.25 spacings) and returns β0, β1, β2 over Z/2. Figures are CPU seconds, the least of the repeats, each method in a process of its
own with one thread. A method that cannot be had here says so in its row.

Python peers come from PyPI into a virtual environment beside the build (target/race/venv, or in CARGO_TARGET_DIR). GUDHI's Čech complex exists in C++ only:
`apt install g++ libgudhi-dev libcgal-dev libeigen3-dev libboost-dev`, and it is compiled here. PHAT and dionysus build from source and need a compiler and
Boost; where that fails they are left out.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
WORK = TARGET / "race"
SURFACES = ["sphere", "torus", "genus2"]
PACKAGES = ["numpy", "scipy", "gudhi", "ripser", "oineus", "dionysus"]
ONE_THREAD = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}


def prepare():
    """Builds our examples, the environment and GUDHI's Čech; returns the interpreter and what is missing, with the reason."""
    WORK.mkdir(parents=True, exist_ok=True)
    for example in ["betti", "nets"]:
        run(["cargo", "build", "--release", "-q", "-p", "cech-complex", "--example", example], cwd=ROOT)
    python = WORK / "venv" / "bin" / "python"
    if not python.exists():
        run([sys.executable, "-m", "venv", str(WORK / "venv")])
    missing = {}
    for package in PACKAGES:
        installed = subprocess.run([python, "-c", f"import {package}"], capture_output=True)
        if installed.returncode != 0:
            done = subprocess.run([python, "-m", "pip", "install", "-q", package], capture_output=True, text=True)
            if done.returncode != 0:
                missing[package] = "pip: " + last_line(done.stderr)
    compiler = ["g++", "-O3", "-DNDEBUG", "-std=c++17", "-I/usr/include/eigen3", str(HERE / "cech.cpp"), "-o", str(WORK / "cech"), "-lgmp", "-lmpfr"]
    if not (WORK / "cech").exists():
        try:
            done = subprocess.run(compiler, capture_output=True, text=True)
            if done.returncode != 0:
                missing["cech"] = "g++: " + next((l for l in done.stderr.splitlines() if "error" in l), "failed")
        except FileNotFoundError:
            missing["cech"] = "no g++"
    return python, missing


def run(command, **options):
    return subprocess.run(command, check=True, capture_output=True, text=True, **options).stdout


def last_line(text):
    return (text.strip().splitlines() or ["failed"])[-1][:100]


def ours(stem, radius, half, only):
    command = [str(TARGET / "release/examples/betti"), f"{stem}.ply", "--radius", str(radius), "--height", str(radius * half), "--json"]
    answer = json.loads(run(command + (["--only"] if only else []), env=ONE_THREAD))
    ms = answer["betti_ms"] if only else answer["build_ms"] + answer["reduce_ms"]
    return {"simplices": sum(answer.get("simplices", [])), "betti": answer["betti"], "seconds": ms / 1e3}


def cech(stem, radius, kernel):
    answer = json.loads(run([str(WORK / "cech"), f"{stem}.txt", str(radius), kernel], env=ONE_THREAD))
    return {**answer, "seconds": (answer["build_ms"] + answer["reduce_ms"]) / 1e3}


def peer(python, name, stem, radius):
    return json.loads(run([str(python), str(HERE / "peers.py"), name, f"{stem}.txt", str(radius)], env=ONE_THREAD))


def methods(python, missing):
    """Name, function of a cloud, and why it is missing if it is."""
    yield "cech-complex (height = radius/2)", lambda stem, radius: ours(stem, radius, 0.5, False), None
    yield "cech-complex, betti_numbers", lambda stem, radius: ours(stem, radius, 0.5, True), None
    for kernel in ["fast", "safe"]:
        yield f"GUDHI Cech C++ {kernel}", lambda stem, radius, k=kernel: cech(stem, radius, k), missing.get("cech")
    for name, package in [
        ("GUDHI Rips dim 3", "gudhi"),
        ("GUDHI Rips collapsed", "gudhi"),
        ("GUDHI alpha", "gudhi"),
        ("ripser.py sparse", "ripser"),
        ("oineus VR", "oineus"),
        ("dionysus Rips", "dionysus"),
    ]:
        yield name, lambda stem, radius, n=name: peer(python, n, stem, radius), missing.get(package)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[2000, 8000])
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    python, missing = prepare()
    print("not in this race: PHAT (its PyPI source does not build with current compilers), GUDHI Cech from Python (the wheel has none)")
    for size in arguments.sizes:
        for surface in SURFACES:
            stem = WORK / f"{surface}-{size}"
            made = json.loads(run([str(TARGET / "release/examples/nets"), surface, str(size), "1", str(stem), "--json"]))
            race(surface, size, stem, made, list(methods(python, missing)), arguments.repeats)


def race(surface, size, stem, made, entries, repeats):
    radius = 1.25 * made["spacing"]
    print(f"\n{surface}, {size} points, betti {made['betti']}, radius {radius:.4g}")
    print(f"  {'method':34} {'simplices':>10} {'betti':>12} {'CPU s':>8} {'complex/it':>10} {'betti_numbers/it':>16}")
    ours = []
    for name, method, reason in entries:
        if reason:
            print(f"  {name:34} not available: {reason}")
            continue
        try:
            answers = [method(stem, radius) for _ in range(repeats)]
        except subprocess.CalledProcessError as error:
            print(f"  {name:34} failed: {last_line(error.stderr)}")
            continue
        best = min(answers, key=lambda answer: answer["seconds"])
        if name.startswith("cech-complex"):
            ours.append(best["seconds"])
        ratios = f"{ours[0] / best['seconds']:10.2f} {ours[-1] / best['seconds']:16.2f}"
        right = "" if best["betti"] == made["betti"] else "  wrong"
        betti = ",".join(map(str, best["betti"]))
        print(f"  {name:34} {best['simplices']:>10} {betti:>12} {best['seconds']:8.3f} {ratios}{right}", flush=True)


if __name__ == "__main__":
    main()
