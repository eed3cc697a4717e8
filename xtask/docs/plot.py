"""A small plot as SVG, on a white card that is legible on light and dark pages. Only the standard library."""

import math
from html import escape

WIDTH, HEIGHT, FONT = 720, 520, 21
LEFT, RIGHT, BOTTOM = 104, 24, 76
COLOURS = ["#0072b2", "#d55e00", "#00946e", "#b75891", "#3c3c3c", "#9e7400"]
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Axis:
    """From values to pixels."""

    def __init__(self, values, low, high, log=False, limits=None, ticks=None):
        self.log = log
        least, most = limits or (min(values), max(values))
        self.least, self.most = self.measure(least), self.measure(most)
        if limits is None and not log:
            margin = 0.04 * (self.most - self.least)
            self.least, self.most = self.least - margin, self.most + margin
        self.low, self.high = low, high
        self.ticks = ticks or self.round_values()

    def measure(self, value):
        return math.log10(value) if self.log else value

    def place(self, value):
        share = (self.measure(value) - self.least) / (self.most - self.least)
        return self.low + share * (self.high - self.low)

    def holds(self, value):
        return value > 0 or not self.log

    def round_values(self):
        if self.log:
            first, last = math.ceil(self.least - 1e-9), math.floor(self.most + 1e-9)
            step = max(1, round((last - first) / 6))
            return [10.0**k for k in range(first, last + 1, step)]
        raw = (self.most - self.least) / 5
        size = 10 ** math.floor(math.log10(raw))
        step = min((f * size for f in (1, 2, 5, 10)), key=lambda s: abs(math.log(s / raw)))
        first = math.ceil(self.least / step - 1e-9)
        return [step * k for k in range(first, math.floor(self.most / step + 1e-9) + 1)]

    def label(self, value):
        exponent = math.log10(value) if self.log else 0
        if self.log and abs(exponent - round(exponent)) < 1e-9 and not 0 <= exponent <= 3:
            return "10" + str(round(exponent)).translate(SUPERSCRIPT)
        return f"{round(value, 12):g}".replace("-", "−")


def wrapped(words, limit):
    """Lines of at most so many characters."""
    lines = [""]
    for word in words.split():
        if lines[-1] and len(lines[-1]) + len(word) + 1 > limit:
            lines.append("")
        lines[-1] += (" " if lines[-1] else "") + word
    return lines


def mark(x, y, colour, shape):
    if shape == "square":
        return f'<rect x="{x - 5:.1f}" y="{y - 5:.1f}" width="10" height="10" fill="{colour}"/>'
    if shape == "triangle":
        return f'<path d="M{x:.1f} {y - 7:.1f}l7 12h-14z" fill="{colour}"/>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{colour}"/>'


def curve(points, x, y, style):
    """The drawing of one series: a line, dashed or not, with or without marks."""
    places = [(x.place(a), y.place(b)) for a, b in points if x.holds(a) and y.holds(b)]
    colour, parts = style["colour"], []
    if style["line"]:
        path = "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in places)
        dash = ' stroke-dasharray="9 7"' if style["line"] == "dashed" else ""
        parts.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="3"{dash}/>')
    if style["mark"]:
        parts += [mark(a, b, colour, style["mark"]) for a, b in places]
    return parts


def plot(file, title, xlabel, ylabel, series, xlog=False, ylog=False, xlimits=None, ylimits=None, xticks=None, yticks=None):
    """Writes a picture of series, each `(name, points, style)` with a style of `line`, `mark` and `colour`."""
    series = [(name, points, {"line": "solid", "mark": None, "colour": COLOURS[i % len(COLOURS)]} | style)
              for i, (name, points, style) in enumerate(series)]
    out, top = [], 34
    for line in wrapped(title, 54):
        out.append(f'<text x="20" y="{top}" font-weight="600">{escape(line)}</text>')
        top += 28
    left = 20
    for name, _, style in series:
        if not name:
            continue
        width = 62 + 11.4 * len(name)
        if left > 20 and left + width > WIDTH:
            left, top = 20, top + 28
        at = top - 7
        if style["line"]:
            dash = ' stroke-dasharray="9 7"' if style["line"] == "dashed" else ""
            out.append(f'<path d="M{left} {at}h34" stroke="{style["colour"]}" stroke-width="3"{dash}/>')
        if style["mark"]:
            out.append(mark(left + 17, at, style["colour"], style["mark"]))
        out.append(f'<text x="{left + 42}" y="{top}">{escape(name)}</text>')
        left += width
    top += 18
    values = [point for _, points, _ in series for point in points]
    x = Axis([a for a, _ in values if a > 0 or not xlog], LEFT, WIDTH - RIGHT, xlog, xlimits, xticks)
    y = Axis([b for _, b in values if b > 0 or not ylog], HEIGHT - BOTTOM, top, ylog, ylimits, yticks)
    for value in x.ticks:
        at = x.place(value)
        out.append(f'<path d="M{at:.1f} {top}V{HEIGHT - BOTTOM}" stroke="#e2e6ea"/>')
        out.append(f'<text x="{at:.1f}" y="{HEIGHT - BOTTOM + 28}" text-anchor="middle">{x.label(value)}</text>')
    for value in y.ticks:
        at = y.place(value)
        out.append(f'<path d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}" stroke="#e2e6ea"/>')
        out.append(f'<text x="{LEFT - 10}" y="{at + 7:.1f}" text-anchor="end">{y.label(value)}</text>')
    out.append(f'<path d="M{LEFT} {top}V{HEIGHT - BOTTOM}H{WIDTH - RIGHT}" fill="none" stroke="#1b1f24" stroke-width="1.5"/>')
    area = f'x="{LEFT}" y="{top}" width="{WIDTH - RIGHT - LEFT}" height="{HEIGHT - BOTTOM - top}"'
    out.append(f'<clipPath id="area"><rect {area}/></clipPath><g clip-path="url(#area)">')
    for _, points, style in series:
        out += curve(points, x, y, style)
    out.append("</g>")
    middle = (top + HEIGHT - BOTTOM) / 2
    out.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 14}" text-anchor="middle">{escape(xlabel)}</text>')
    out.append(f'<text transform="translate(24 {middle}) rotate(-90)" text-anchor="middle">{escape(ylabel)}</text>')
    head = (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" role="img" '
            f'aria-label="{escape(title)}" font-family="system-ui, sans-serif" font-size="{FONT}" fill="#1b1f24">\n'
            f'<rect width="{WIDTH}" height="{HEIGHT}" rx="8" fill="#ffffff"/>\n')
    file.write_text(head + "\n".join(out) + "\n</svg>\n")
