# SPDX-License-Identifier: MIT
"""Time stamps and dates as text, in whole ns so that nothing is rounded."""
import datetime
import re

CLOCK = r"(?P<h>\d{1,3}):(?P<m>\d{2})(?::(?P<s>\d{2})(?:[.,](?P<f>\d{1,9})\d*)?)?(?:\s*(?P<half>[AaPp][Mm]))?"
ZONE = r"(?:\s*(?P<zone>Z|UTC|GMT|[+-]\d{2}:?\d{2}))?"
MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
DATE = (r"(?:(?P<Y>\d{4})[-/.](?P<M>\d{1,2})[-/.](?P<D>\d{1,2})|"
        rf"(?P<a>\d{{1,2}})(?P<by>[-/. ])(?P<b>\d{{1,2}}|(?i:{'|'.join(MONTHS)}))[-/. ](?P<y>\d{{4}}|\d{{2}}))")
STAMP = re.compile(rf"{DATE}(?:[T _,]\s*{CLOCK}{ZONE})?")
ONLY_CLOCK = re.compile(CLOCK)
SECOND, DAY = 10**9, 86400 * 10**9


def is_stamp(text):
    return STAMP.fullmatch(text) is not None


def is_date(text):
    found = STAMP.fullmatch(text)
    return found is not None and found["h"] is None


def is_clock(text):
    return ONLY_CLOCK.fullmatch(text) is not None


def _clock(found):
    if found["h"] is None:
        return 0
    h, m, s = int(found["h"]), int(found["m"]), int(found["s"] or 0)
    if found["half"]:
        h = h % 12 + (12 if found["half"].lower() == "pm" else 0)
    if m > 59 or s > 60:
        raise ValueError
    return (h * 3600 + m * 60 + s) * SECOND + int((found["f"] or "0").ljust(9, "0"))


def _zone(text):
    if text is None or not text[0] in "+-":
        return 0
    return (1 if text[0] == "+" else -1) * (int(text[1:3]) * 60 + int(text[-2:])) * 60 * SECOND


def read_stamps(texts):
    """Returns the ns of each stamp since some day; None where a text is no stamp. Days before months, or months before
    days, in dates that end with the year: what the dates allow; raises ValueError if they allow both and differ."""
    found = [STAMP.fullmatch(text) for text in texts]
    short = [f for f in found if f and f["a"] and f["b"].isdigit()]
    day_first = any(int(f["a"]) > 12 or f["by"] == "." for f in short)
    if short and not day_first and not any(int(f["b"]) > 12 for f in short) and \
            len({(f["a"], f["b"], f["y"]) for f in short}) > 1:
        raise ValueError("days or months may come first in these dates; write them as 2024-01-31")
    days, result = {}, []
    for f in found:
        try:
            if f is None:
                raise ValueError
            month = f["b"] if not f["b"] or f["b"].isdigit() else MONTHS.index(f["b"].lower()) + 1
            by_day = day_first or month != f["b"]
            date = (f["Y"], f["M"], f["D"]) if f["Y"] else (f["y"], month, f["a"]) if by_day else (f["y"], f["a"], month)
            if date not in days:
                year, month, day = map(int, date)
                days[date] = datetime.date(year + 2000 * (year < 100), month, day).toordinal() * DAY
            if f["h"] and int(f["h"]) > 24:
                raise ValueError
            result.append(days[date] + _clock(f) - _zone(f["zone"]))
        except ValueError:
            result.append(None)
    return result


def read_clocks(texts):
    """Returns the ns of each time of the day since the midnight before the first one; None where a text is none."""
    result, add, last = [], 0, None
    for text in texts:
        found = ONLY_CLOCK.fullmatch(text)
        try:
            now = None if found is None else _clock(found) + add
        except ValueError:
            now = None
        if now is not None and last is not None and now < last - DAY // 2:  # midnight has passed
            add += DAY
            now += DAY
        last = last if now is None else now
        result.append(now)
    return result
