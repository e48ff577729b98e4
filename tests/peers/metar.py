#!/usr/bin/env python3
"""Holds the decoder of METARs against PyPI's `metar` 2.0.2, field by field.

    cargo run -p wm-reports --example decode_metar -- crates/wm-reports/fixtures/metar.txt > decoded.json
    python3 tests/peers/metar.py decoded.json

It needs the package (`pip install metar==2.0.2`) and is no part of `cargo test`. Differences that are meant are named in MEANT, with
the reason; the exit code is 1 if there is any other.
"""

import json
import re
import sys

# This folder, in which this very file would be found as the package.
sys.path.pop(0)
from metar import Metar  # noqa: E402

# What differs on purpose: fields, whether a report is one of those, and the reason.
MEANT = [
    ("auto correction", lambda text: " AUTO " not in text or " COR AUTO " in text, "there a report is automatic or a correction, and automatic unless it is one"),
    ("correction", lambda text: re.search(r" CC[A-Z] ", text), "there the Canadian corrections CCA, CCB are none"),
    ("temperature dew_point", lambda text: re.search(r" RMK .*T[01]\d{3}", text), "there tenths of a degree are read from the remarks"),
    ("clouds", lambda text: " SKC " in text, "there SKC is told as CLR"),
    ("weather visibility visibility_bound", lambda text: re.search(r" /{3,4}(NDV)? ", text), "there a visibility that was not measured is 10 km, and strokes are weather"),
    ("weather", lambda text: re.search(r" (//|/{6}|/{9}|NSW) ", text), "there strokes and NSW are weather"),
    ("clouds", lambda text: re.search(r"\d{3}(SC|AC|CI|CU|///)|/{6}", text), "here genera of clouds other than CB and TCU are not kept, and strokes are none"),
    ("clouds", lambda text: re.search(r"(CB|TCU)(/|-|N|E|S|W)", text), "there clouds whose place is glued on are not read"),
    ("weather clouds", lambda text: re.search(r"SM (FEW|SCT|BKN|OVC)| VC [A-Z]{2} |\+TSRA \+DSSS", text), "there other orders and blanks within groups are not read"),
    ("visibility_bound", lambda text: " CAVOK " in text, "there CAVOK is 10 km, here 10 km or more"),
    ("minimum_visibility", lambda text: re.search(r" 0000[NESW]+ | \d{4}/ ", text), "here 0000 is less than 50 m, and a side may be unknown"),
    ("runway_ranges", lambda text: re.search(r" R\d\d[LCR]?/(////|[DUN] )", text), "here a range that was not measured is one"),
    ("pressure temperature dew_point minimum_visibility", lambda text: re.search(r"[QA]\d{1,3} \d{1,3} |\d/ \d\d | FM\d{4} |/\d\d \d{4} ?", text), "groups that are typed apart or follow the report"),
    ("time", lambda text: " COR " in text[:10], "there COR after the station hides the time"),
]


def number(value, unit):
    return None if value is None else value.value(unit)


def theirs(text):
    seen = Metar.Metar(text, strict=False)
    groups = lambda found: ["".join(part or "" for part in group) for group in found]
    direction = seen.wind_dir.value() if seen.wind_dir is not None else None
    low, high = seen.vis, seen.max_vis
    return {
        "kind": seen.type,
        "station": seen.station_id,
        "time": [seen.time.day, seen.time.hour, seen.time.minute] if seen.time else None,
        "auto": seen.mod == "AUTO",
        "correction": seen.correction is not None or seen.mod == "COR",
        "wind_from": direction,
        "wind_speed": number(seen.wind_speed, "MPS"),
        "wind_gust": number(seen.wind_gust, "MPS"),
        "wind_between": [seen.wind_dir_from.value(), seen.wind_dir_to.value()] if seen.wind_dir_from else None,
        "visibility": number(low, "M"),
        "visibility_bound": (low._gtlt or "") if low else None,
        "minimum_visibility": number(high, "M"),
        "runway_ranges": [[name, [a.value("M"), b.value("M")]] for name, a, b, *_ in seen.runway],
        "weather": groups(seen.weather),
        "recent": groups(seen.recent),
        "clouds": [[cover, number(height, "M"), kind] for cover, height, kind in seen.sky],
        "temperature": number(seen.temp, "C"),
        "dew_point": number(seen.dewpt, "C"),
        "pressure": number(seen.press, "HPA"),
    }


def ours(line):
    see = lambda seen: seen and seen["metres"]
    cover = lambda code: code[:2] if code.startswith("VV") else code[:3]
    return {
        **{name: line[name] for name in ("kind", "station", "time", "auto", "correction", "wind_from", "wind_speed", "wind_gust")},
        **{name: line[name] for name in ("wind_between", "runway_ranges", "weather", "recent", "temperature", "dew_point", "pressure")},
        "visibility": see(line["visibility"]),
        "visibility_bound": line["visibility"] and line["visibility"]["bound"],
        "minimum_visibility": see(line["minimum_visibility"]),
        "clouds": [[cover(code), height, kind] for code, height, kind in line["clouds"]],
    }


def same(a, b, tolerance):
    if isinstance(a, (int, float)) and isinstance(b, (int, float)) and not isinstance(a, bool):
        return abs(a - b) <= tolerance * max(1.0, abs(a))
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(same(x, y, tolerance) for x, y in zip(a, b))
    return a == b


def main():
    lines = [json.loads(line) for line in open(sys.argv[1])]
    compared = differences = meant = 0
    for line in lines:
        if "error" in line:
            print(f"not read here: {line['text']}: {line['error']}")
            differences += 1
            continue
        own, other = ours(line), theirs(line["text"])
        for field in own:
            compared += 1
            # Its knots and miles have four digits.
            if same(own[field], other[field], 1e-3):
                continue
            reason = next((why for names, is_one, why in MEANT if field in names.split() and is_one(line["text"])), None)
            print(f"{'meant' if reason else 'DIFFERS'} {field}: here {own[field]}, there {other[field]}: {reason or line['text']}")
            meant += reason is not None
            differences += reason is None
    print(f"{len(lines)} reports, {compared} fields compared, {meant} meant differences, {differences} others")
    return 1 if differences else 0


if __name__ == "__main__":
    sys.exit(main())
