"""The table and the charts of a comparison."""

import json
import math
import re
from collections import defaultdict
from datetime import date
from pathlib import Path

COLOURS = {"sprung": "#0b6e99", "Eigen": "#b5651d", "CHOLMOD": "#5b7f3a", "scipy": "#7a5195", "pyamg": "#7a5195"}
# Stage, title and the stages that add up to it.
CHARTS = [
    ("product", "A·w", ["product"]),
    ("refill", "assembly of A", ["refill A"]),
    ("direct", "direct step: refill (but for CHOLMOD), factor, solve", ["refill A", "factor", "solve"]),
    ("cg", "conjugate gradients to 1e-10, set-up included",
     ["cg none", "cg jacobi", "cg block-jacobi", "cg multigrid", "cg incomplete-cholesky"]),
    ("memory", "memory of a run", ["memory block-jacobi", "memory multigrid"]),
]
STYLES = {"multigrid": "-", "block-jacobi": ":", "jacobi": "-.", "none": (0, (1, 4)), "incomplete-cholesky": "--", "": "-"}


def cpu():
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":")[1].strip()
    return "unknown processor"


def number(value):
    return "–" if value is None else f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def table(results):
    """Ours beside the fastest peer with as many threads, stage by stage."""
    scenes = list(dict.fromkeys(result["scene"] for result in results))
    stages = list(dict.fromkeys(result["stage"] for result in results if not result["stage"].startswith(("five steps", "memory"))))
    rows = ["| scene | stage | T1 (ms) | over floor | T2 | over floor | peer T1 (ms) | peer / sprung T1 | peer T2 | peer / sprung T2 |",
            "|---|---|---|---|---|---|---|---|---|---|"]
    ours = {(r["scene"], r["stage"], r["threads"]): r for r in results if r["library"] == "sprung"}

    def against(mine, scene, stage, threads):
        kind = stage.split()[0] if stage.startswith("cg") else stage
        peers = [r for r in results if r["library"] != "sprung" and r["scene"] == scene and r["threads"] == threads
                 and (r["stage"].split()[0] if kind == "cg" else r["stage"]) == kind]
        peer = min(peers, key=lambda r: r["ms"], default=None)
        return [f"{number(peer['ms'])} ({peer['library']})", number(peer["ms"] / mine["ms"])] if peer and mine else ["–", "–"]

    for scene in scenes:
        for stage in stages:
            one, two = ours.get((scene, stage, 1)), ours.get((scene, stage, 2))
            if not one:
                continue
            extra = f" ({one['iterations']} iterations)" if "iterations" in one else ""
            cells = [scene, stage + extra]
            for mine in (one, two):
                cells += [number(mine["ms"]), number(mine.get("ratio"))] if mine else ["–", "–"]
            cells += against(one, scene, stage, 1) + against(two, scene, stage, 2)
            rows.append("| " + " | ".join(cells) + " |")
    return rows


# What is set beside the time it took at an earlier commit.
SINCE = ["product", "refill A", "right-hand side", "factor", "solve", "cg none", "cg block-jacobi", "cg multigrid"]


def since(folder):
    """The time of one thread over what it was at an earlier commit, and over the floor where there is one."""
    record = json.loads((folder / "since.json").read_text())
    times = {(r["scene"], r["library"], r["stage"]): r for r in record["results"]}
    rows = ["| scene | " + " | ".join(SINCE) + " |", "|---" * (len(SINCE) + 1) + "|"]
    for scene in dict.fromkeys(r["scene"] for r in record["results"]):
        cells = []
        for stage in SINCE:
            now, before = (times.get((scene, library, stage)) for library in ("sprung", "sprung before"))
            over = f" ({number(now['ratio'])} over floor)" if now and now.get("ratio") else ""
            cells.append(number(now["ms"] / before["ms"]) + over if now and before else "–")
        rows.append(f"| {scene} | " + " | ".join(cells) + " |")
    head = (f"Time of one thread over what it was at commit `{record['commit']}`, medians of five turns on {record['day']}.")
    return "## Since an earlier commit\n\n" + head + "\n\n" + "\n".join(rows) + "\n\n"


def best_of(results, scene, library, stage, threads=None):
    times = [r["ms"] for r in results if (r["scene"], r["library"], r["stage"]) == (scene, library, stage)
             and threads in (None, r["threads"])]
    return min(times, default=None)


def direct_step(results, scene, library):
    """Refill, factor and solve; CHOLMOD is handed its matrix. The best of one and two threads, stage by stage."""
    stages = ["factor", "solve"] if library == "CHOLMOD" else ["refill A", "factor", "solve"]
    times = [best_of(results, scene, library, stage) for stage in stages]
    return None if None in times else sum(times)


def verdict(values, bounds):
    """Whether what was measured is within its bounds, of those scenes that have one."""
    judged = [(value <= bound if sign == "≤" else value >= bound)
              for scene, value in values if value is not None and scene in bounds for sign, bound in [bounds[scene]]]
    if not judged:
        return "no target"
    return "met" if all(judged) else f"missed in {judged.count(False)} of {len(judged)}"


def targets(results):
    """What was aimed at beside what was measured, and whether it was reached."""
    ours = {(r["scene"], r["stage"], r["threads"]): r for r in results if r["library"] == "sprung"}
    particles = {r["scene"]: r["particles"] for r in results}
    rows = ["| stage | target | measured | verdict |", "|---|---|---|---|"]

    def row(stage, target, values, bounds, unit=""):
        texts = [f"{scene}: {number(value)}{unit}" for scene, value in values if value is not None]
        if texts:
            rows.append(f"| {stage} | {target} | {'; '.join(texts)} | {verdict(values, bounds)} |")

    def sized(sign, *steps):
        """Bounds by size: (least particles, most particles, bound)."""
        return {scene: (sign, bound) for scene, count in particles.items()
                for least, most, bound in steps if least <= count < most}

    def over_floor(scene, stages, threads):
        parts = [ours.get((scene, stage, threads)) for stage in stages]
        return None if None in parts else sum(p["ms"] for p in parts) / sum(p["floor_ms"] for p in parts)

    large = [scene for scene in particles if scene in ("cloth 316", "cloth 1000", "lattice 46")]
    everywhere = lambda sign, bound: {scene: (sign, bound) for scene in particles}
    assembly = ["refill A", "right-hand side"]
    row("refill of A and right-hand side over floor, T1", "≤ 1.5", [(s, over_floor(s, assembly, 1)) for s in large], everywhere("≤", 1.5))
    row("the same, T2", "", [(s, over_floor(s, assembly, 2)) for s in large], {})

    def ratio(theirs, mine):
        return theirs / mine if theirs and mine else None

    # Sizes are named by their power of ten: 10⁵ is the cloth of 316² and the lattice of 46³, 10⁴ that of 100² and 22³.
    row("Eigen's triplets / refill, T1", "≥ 30 at 10⁵",
        [(s, ratio(best_of(results, s, "Eigen", "refill A"), best_of(results, s, "sprung", "refill A", 1))) for s in particles],
        sized("≥", (9e4, 2e5, 30)))
    for peer, target, bounds in (
            ("CHOLMOD", "≥ 1.5 at 10⁴–10⁵, ≥ 2 at 10⁶", sized("≥", (9e3, 2e5, 1.5), (5e5, 2e6, 2))),
            ("Eigen", "≥ 40 at 10⁵", sized("≥", (9e4, 2e5, 40)))):
        row(f"direct step, {peer} / sprung, best of T1 and T2", target,
            [(s, ratio(direct_step(results, s, peer), direct_step(results, s, "sprung"))) for s in particles], bounds)
    for threads, bound in ((2, 1.1), (1, 1.3)):
        row(f"A·w over floor, T{threads}", f"≤ {bound} at 10⁶", [(s, over_floor(s, ["product"], threads)) for s in large],
            sized("≤", (5e5, 2e6, bound)))
    multigrid = [(s, ours[s, "cg multigrid", 2]) for s in particles if (s, "cg multigrid", 2) in ours]
    row("multigrid to 1e-10, iterations", "≤ 30 from 10⁴ to 10⁶",
        [(s, r["iterations"]) for s, r in multigrid if r["particles"] > 9000], everywhere("≤", 30))
    row("multigrid to 1e-10, set-up and solve, T2", "cloth 316 ≤ 0.45 s, cloth 1000 ≤ 6 s, lattice 46 ≤ 0.5 s",
        [(s, r["ms"] / 1e3) for s, r in multigrid if s in large],
        {"cloth 316": ("≤", 0.45), "cloth 1000": ("≤", 6), "lattice 46": ("≤", 0.5)}, " s")

    def against_best(scene):
        times = {r["stage"]: r["ms"] for r in results if r["scene"] == scene and r["stage"].startswith("five steps")}
        auto = times.pop("five steps, auto", None)
        return ratio(auto, min(times.values(), default=None))

    row("five steps with `auto`, after five in which it chose, / with the best choice", "≤ 1.15",
        [(s, against_best(s)) for s in particles], everywhere("≤", 1.15))
    for kind, bound in (("block-jacobi", 1.5), ("multigrid", 4)):
        row(f"memory of a run a particle, {kind}", f"≤ {bound} KB",
            [(s, ours[s, f"memory {kind}", 2]["bytes_per_particle"] / 1e3) for s in large if (s, f"memory {kind}", 2) in ours],
            everywhere("≤", bound), " KB")
    return rows


def slope(points):
    """Least squares in the logarithms."""
    logs = [(math.log(x), math.log(y)) for x, y in points]
    mean_x, mean_y = (sum(c) / len(logs) for c in zip(*logs))
    spread = sum((x - mean_x) ** 2 for x, _ in logs)
    return sum((x - mean_x) * (y - mean_y) for x, y in logs) / spread if spread else float("nan")


def power_of_ten(count):
    return f"about 10{str(round(math.log10(count))).translate(str.maketrans('0123456789', '⁰¹²³⁴⁵⁶⁷⁸⁹'))} particles"


def conclusion(kind, curves):
    """What the points say: ours beside the peers, on one thread each, at the largest size that a peer has too."""
    if kind == "memory":
        count = max(count for points in curves.values() for count, _ in points)
        each = sorted((dict(points)[count] * 1e3 / count, detail) for (_, _, detail), points in curves.items() if count in dict(points))
        kilobytes = " and ".join(f"{value:.1f} KB with {detail}" for value, detail in each)
        return f"At {power_of_ten(count)} a particle takes {kilobytes}."
    best = defaultdict(dict)
    for (library, threads, detail), points in curves.items():
        for count, value in points if threads == 1 else []:
            known = best[library].get(count)
            best[library][count] = min(filter(None, [known, (value, detail)]))
    ours = best.pop("sprung", {})
    shared = [count for count in ours if any(count in theirs for theirs in best.values())]
    if not shared:
        return ""
    count = max(shared)
    value, detail = ours[count]
    peers = sorted((theirs[count][0], library) for library, theirs in best.items() if count in theirs)
    how = f" with {detail}" if detail else ""
    times = f"{number(value)} ms" if value < 1000 else f"{number(value / 1e3)} s"
    others = ", ".join(f"{library} {number(time / value)} times" for time, library in peers)
    return f"At {power_of_ten(count)}, one thread each: sprung {times}{how}; {others} as long."


def chart(results, family, title, stages, file):
    import matplotlib
    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "sprung"})
    kind = stages[0].split()[0]
    parts = len(stages) > 1 and kind not in ("cg", "memory")
    curves, floors = defaultdict(dict), defaultdict(dict)
    for result in results:
        if not result["scene"].startswith(family) or result["stage"] not in stages:
            continue
        label = (result["library"], result["threads"], "" if parts or len(stages) == 1 else result["stage"].split()[1])
        at = curves[label].setdefault(result["particles"], {})
        at[result["stage"]] = result["bytes"] / 1e6 if kind == "memory" else result["ms"]
        if "floor_ms" in result and len(stages) == 1:
            floors[result["threads"]][result["particles"]] = result["floor_ms"]
    figure, axes = plt.subplots(figsize=(9, 4.6))
    known = {}
    for (library, threads, detail), points in sorted(curves.items()):
        # CHOLMOD is handed its matrix.
        needed = {"factor", "solve"} if library == "CHOLMOD" else set(stages)
        whole = [(n, sum(ms.values())) for n, ms in sorted(points.items()) if not parts or needed <= set(ms)]
        if not whole:
            continue
        known[library, threads, detail] = whole
        if kind == "cg" and threads == 1 and (library, 2, detail) in curves:
            continue  # the table has both
        text = f"{library} {detail} T{threads}".replace("  ", " ")
        if len(whole) > 2:
            text += f", slope {slope(whole[-3:]):.2f}"
        marker = "o" if threads == 1 else "s"
        axes.loglog(*zip(*whole), marker=marker, markersize=4, linestyle=STYLES[detail], color=COLOURS[library], label=text,
                    alpha=1.0 if threads == 2 else 0.6)
    for threads, points in sorted(floors.items()):
        axes.loglog(*zip(*sorted(points.items())), color="black", linewidth=0.9, linestyle="--" if threads == 1 else "-",
                    label=f"bytes moved / bandwidth, T{threads}")
    if known:
        axes.set(xlabel="particles", ylabel="memory, MB" if kind == "memory" else "time, ms")
        figure.suptitle(f"{title[:1].upper()}{title[1:]}, {family}", x=0.02, ha="left", fontweight="bold")
        axes.set_title(conclusion(kind, known), fontsize=10, loc="left", x=-0.08)
        axes.grid(True, which="major", linewidth=0.4, alpha=0.5)
        axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
        figure.tight_layout()
        figure.savefig(file, metadata={"Date": None})
    plt.close(figure)
    return bool(known)


def write(results, folder, day=None, machine=None):
    families = list(dict.fromkeys(result["scene"].split()[0] for result in results))
    pictures = []
    for family in families:
        for name, title, stages in CHARTS:
            file = folder / f"{family}-{name}.svg"
            if chart(results, family, title, stages, file):
                pictures.append(f"![{title}, {family}]({file.name})")
    text = f"""# Measurements

Written by `benches/compare/run.py` on {day or date.today().isoformat()}, {machine or cpu()}. Medians of repeats; T1 and T2 are one and two threads.
One thread is timed by its processor time, ours and the peers' alike, two threads by the clock: on a machine that does
other work besides, T2 means little. "Over floor" is the time over that of moving the bytes that the
stage cannot avoid, at the bandwidth of a triad measured between the repeats, write-allocation counted in both; below
about 10⁵ particles the data fits the caches and the ratio says little. The last columns set our
one thread against the fastest peer's on one, for conjugate gradients whatever its preconditioner, and our two against two.

The first call of everything, which takes new memory from the system, does not count.

The scenes are those of `benches/scenes.rs`. All numbers are in `results.json`.

"""
    text += "## Targets\n\n" + "\n".join(targets(results)) + "\n\n"
    remarks = folder / "remarks.md"
    if remarks.exists():
        text += remarks.read_text() + "\n"
    if (folder / "since.json").exists():
        text += since(folder)
    text += "## All stages\n\n"
    (folder / "README.md").write_text(text + "\n".join(table(results)) + "\n\n" + "\n\n".join(pictures) + "\n")


def render_again():
    """Table and pictures from the results of an earlier measurement, under its date and machine."""
    folder = Path(__file__).resolve().parents[2] / "docs" / "performance"
    day, machine = re.search(r"`benches/compare/run.py` on ([-0-9]+), (.*)\. Medians", (folder / "README.md").read_text()).groups()
    write(json.loads((folder / "results.json").read_text()), folder, day, machine)


if __name__ == "__main__":
    render_again()
