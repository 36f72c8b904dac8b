"""The font of the figures, cut down to the characters in use, for a page that needs nothing from outside."""

from __future__ import annotations

import base64
import io
from pathlib import Path

import matplotlib as mpl
from fontTools import subset
from fontTools.ttLib import TTFont

_FILE = Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")


def embedded(family: str, characters: str) -> str:
    """A CSS ``@font-face`` rule that holds DejaVu Sans, reduced to `characters`, under the name `family`."""
    options = subset.Options(layout_features=["kern"], hinting=False, notdef_outline=True)
    options.drop_tables += ["FFTM"]
    font = TTFont(_FILE, recalcTimestamp=False)
    subsetter = subset.Subsetter(options)
    subsetter.populate(text=characters + " ")
    subsetter.subset(font)
    buffer = io.BytesIO()
    font.flavor = "woff"
    font.save(buffer)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'@font-face{{font-family:"{family}";src:url(data:font/woff;base64,{data}) format("woff")}}'
