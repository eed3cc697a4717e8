"""The page of `frames.py`: verdicts, tables and pictures, from what was measured."""

import math
import re
import statistics
from collections import defaultdict
from datetime import date
from pathlib import Path

ACCURACIES = [1e-1, 1e-2, 1e-3, 1e-4, 1e-6]
COLOURS = {"sprung": "#0b6e99", "MuJoCo": "#b5651d", "Newton": "#5b7f3a", "Taichi": "#7a5195"}
# Nearer to the reference than this a conversion is taken as right even where single precision leaves no room for an order between the
# longest stable step and rounding: a stiffness wrong by 2 % ends 1.3e-3 away on the cloth of 32², damping wrong by a factor of 2 1.1e-3.
NEAR = 5e-4
MARKERS = "osD^vP*X"
# Where results begin on the page; what stands above was written by hand and stays.
MARK = "## Results\n"


def processor():
    return next((line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")),
                "unknown processor")


def number(value):
    return "–" if value is None else f"{value:.2g}" if value < 100 else f"{value:.0f}"


def curves_of(results, scene):
    """Of every contender: (setting, error, ms a frame), errors None where the run failed."""
    curves = defaultdict(list)
    for point in results["points"]:
        if point["scene"] == scene:
            curves[point["simulator"], point["method"]].append((point["setting"], point["error"], statistics.median(point["ms"])))
    return {who: sorted(points, key=lambda p: p[0] if results["methods"][" ".join(who)]["order"] else -p[0]) for who, points in curves.items()}


def cheapest(points, accuracy):
    """The least time of the runs that err less, with its setting."""
    return min(((ms, setting) for setting, error, ms in points if error is not None and error <= accuracy), default=None)


def observed_order(points, floor):
    """By the shortest step and its double of which both errors are well above what rounding and the reference leave."""
    kept = [(steps, error) for steps, error, _ in points if error is not None]
    least = min(range(len(kept)), key=lambda n: kept[n][1], default=0)
    bound = max(10 * floor, 1.5 * kept[least][1] if least < len(kept) - 1 else 0.0) if kept else 0.0
    for fine, small in reversed(kept[:least + 1]):
        coarse = [error for steps, error in kept if 2 * steps == fine]
        if coarse and small > bound and coarse[0] < 0.3:
            return math.log2(coarse[0] / small)
    return None


def described(who, setting, results):
    simulator, method = who
    order = results["methods"][" ".join(who)]["order"]
    return f"{method}" + (f" × {setting:g}" if order else f" {setting:g}" if simulator == "sprung" else "")


def verdict(ratio):
    if ratio is None:
        return "only sprung"
    return "ahead" if ratio >= 1.1 else "even" if ratio > 1 / 1.3 else "behind"


def duel(results, curves):
    """Ours beside the best peer, accuracy by accuracy."""
    rows = ["| error below | sprung, ms a frame | by | best peer, ms a frame | by | peer / sprung | verdict |", "|---|---|---|---|---|---|---|"]
    for accuracy in ACCURACIES:
        found = [(*best, who) for who, points in curves.items() if (best := cheapest(points, accuracy))]
        mine = min((f for f in found if f[2][0] == "sprung"), default=None)
        peer = min((f for f in found if f[2][0] != "sprung"), default=None)
        ratio = peer[0] / mine[0] if mine and peer else None
        cells = [f"{accuracy:g}"]
        cells += [number(mine[0]), described(mine[2], mine[1], results)] if mine else ["–", "–"]
        cells += [number(peer[0]), f"{peer[2][0]} {described(peer[2], peer[1], results)}"] if peer else ["–", "–"]
        rows.append("| " + " | ".join([*cells, number(ratio), verdict(ratio) if mine else "not reached"]) + " |")
    return rows


def whole(results, scene, curves):
    """Every contender's least time for each accuracy, its least error and its order; and whose conversion is not shown."""
    rows = ["| ms a frame for an error below |" + "".join(f" {a:g} |" for a in ACCURACIES) + " least error | order, observed / in theory |",
            "|---|" + "---|" * (len(ACCURACIES) + 2)]
    shown = defaultdict(bool)
    for who, points in curves.items():
        order = results["methods"][" ".join(who)]["order"]
        seen = observed_order(points, results["scenes"][scene]["difference"]) if order else None
        least = min((error for _, error, _ in points if error is not None), default=None)
        in_order = bool(seen and abs(seen - order) < 0.3 and least < 1e-2)
        shown[who[0]] |= in_order or bool(order and least is not None and least < NEAR)
        cells = [number(best[0]) if (best := cheapest(points, a)) else "–" for a in ACCURACIES]
        cells += [f"{least:.1e}" if least is not None else "failed", f"{seen:.2f} / {order}" if seen is not None else f"– / {order}" if order else ""]
        rows.append(f"| {' '.join(who)} | " + " | ".join(cells) + " |")
    return rows, [simulator for simulator, right in shown.items() if not right]


def leading(curves):
    """Three of ours and three of others, those that are cheapest at the most accuracies; of others first the best of each program."""
    def wins(whose):
        count = defaultdict(float)
        for accuracy in ACCURACIES:
            times = sorted((best[0], who) for who, points in curves.items() if whose(who) and (best := cheapest(points, accuracy)))
            for place, (_, who) in enumerate(times[:3]):
                count[who] += 1 / (1 + place)
        return sorted(count, key=count.get, reverse=True)

    ours, others = wins(lambda who: who[0] == "sprung"), wins(lambda who: who[0] != "sprung")
    first = {}
    for who in others:
        first.setdefault(who[0], who)
    others = [*first.values(), *(who for who in others if who not in first.values())]
    return {who: curves[who] for who in [*ours[:3], *others[:3]]}


def takeaway(curves):
    """Where ours is ahead, in a line."""
    ratios = {}
    for accuracy in ACCURACIES:
        found = [(best[0], who[0] == "sprung") for who, points in curves.items() if (best := cheapest(points, accuracy))]
        mine, peer = (min((ms for ms, is_mine in found if is_mine == which), default=None) for which in (True, False))
        if mine:
            ratios[accuracy] = peer / mine if peer else math.inf
    # From the smallest error up to the first at which it is not.
    ahead = []
    for accuracy in sorted(ratios):
        if ratios[accuracy] < 1.1:
            break
        ahead.append(accuracy)
    if not ahead:
        return "sprung is not ahead"
    known = [ratios[accuracy] for accuracy in ahead if math.isfinite(ratios[accuracy])]
    factors = " to ".join(f"{factor:.2g}" for factor in sorted({min(known), max(known)})) if known else None
    return f"for errors of {max(ahead):g} and less sprung is {f'{factors} times as fast as the best of the others' if factors else 'alone'}"


def draw(scene, curves, difference, title, file):
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "sprung"})
    figure, axes = plt.subplots(figsize=(10, 5))
    count = defaultdict(int)
    for (simulator, method), points in curves.items():
        good = [(error, ms) for _, error, ms in points if error]
        if good:
            axes.loglog(*zip(*good), color=COLOURS[simulator], marker=MARKERS[count[simulator] % len(MARKERS)], markersize=4, linewidth=1.1,
                        linestyle="-" if simulator == "sprung" else "--", label=f"{simulator} {method}")
            count[simulator] += 1
    axes.axvline(difference, color="black", linewidth=0.6)
    axes.set(xlabel="relative position error at the end (left is more accurate)", ylabel="processor time a frame, ms")
    axes.set_title(f"{scene}: {title}", loc="left", fontweight="bold")
    axes.grid(True, which="major", linewidth=0.4, alpha=0.5)
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.tight_layout()
    figure.savefig(file, metadata={"Date": None})
    plt.close(figure)


def write(results, folder):
    """Replaces the results on the page; returns the conversions that convergence did not show to be right."""
    versions = ", ".join(f"{name} {version}" for name, version in results["versions"].items())
    text = [MARK, f"Measured on {results.setdefault('measured', f'{date.today().isoformat()}, {processor()}')}, one thread each, with {versions}.\n"]
    doubts = []
    for scene, facts in results["scenes"].items():
        curves = curves_of(results, scene)
        name = f"frames-{scene.replace(' ', '-')}"
        draw(scene, leading(curves), facts["difference"], takeaway(curves), folder / f"{name}.svg")
        draw(scene, curves, facts["difference"], "all methods", folder / f"{name}-all.svg")
        rows, wrong = whole(results, scene, curves)
        doubts += [f"{scene}: {simulator}" for simulator in wrong]
        text += [f"### {scene}\n", f"{facts['particles']} particles, {facts['springs']} springs, {facts['frames']} frames of 1/60 s. "
                 f"The two references differ by {facts['difference']:.0e}, which the thin vertical line in the picture marks.\n", *duel(results, curves), "",
                 f"![Time of a frame over error, {scene}]({name}.svg)\n", "<details><summary>All methods</summary>\n",
                 f"![Time of a frame over error, {scene}, all methods]({name}-all.svg)\n", *rows, "", "</details>\n"]
        if wrong:
            text.append(f"Convergence was not seen, within the limit of time, of any method of {' and '.join(wrong)} here.\n")
    page = folder / "frames.md"
    above = re.split(f"^{MARK}", page.read_text(), flags=re.MULTILINE)[0] if page.exists() else "# What a frame costs at equal error\n\n"
    page.write_text(above + "\n".join(text))
    for doubt in doubts:
        print(f"not shown to be converted right: {doubt}")
    return doubts
