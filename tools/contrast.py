"""Contrast of the texts of a page, as WCAG 2.2 defines it, for tests in Chromium."""

from __future__ import annotations

from typing import Any

from tools.browser import Page

LEAST = 4.5
"""Of texts of the usual size (level AA)."""
LEAST_LARGE = 3.0
"""Of texts of 24 px, or of 18.66 px in bold."""
BEHIND = (205, 213, 221)
"""What panels that let through some light are taken to lie on: the floor of the scene."""
_MEASURE = """
(() => {
  const parse = (text) => (text.match(/[\\d.]+/g) ?? ["0", "0", "0", "0"]).map(Number);
  const over = ([r, g, b, a = 1], back) => [r, g, b].map((v, k) => a * v + (1 - a) * back[k]);
  const bright = (rgb) => rgb.map((v) => v / 255)
    .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const backOf = (item) => {
    const layers = [];
    for (let at = item; at; at = at.parentElement) layers.push(parse(getComputedStyle(at).backgroundColor));
    return layers.slice(0, -2).reverse().reduce((back, layer) => over(layer, back), BEHIND);
  };
  const measured = [];
  for (const item of document.querySelectorAll("body *")) {
    if (["OPTION", "SCRIPT", "STYLE"].includes(item.tagName)) continue;
    const text = item.tagName === "SELECT" ? item.selectedOptions[0]?.textContent ?? ""
      : [...item.childNodes].filter((node) => node.nodeType === 3).map((node) => node.textContent.trim()).join("");
    const box = item.getBoundingClientRect();
    if (!text || !box.width || !box.height || !item.checkVisibility({ visibilityProperty: true })) continue;
    const style = getComputedStyle(item), back = backOf(item);
    const [one, two] = [bright(over(parse(style.color), back)), bright(back)];
    const [size, bold] = [parseFloat(style.fontSize), Number(style.fontWeight) >= 700];
    measured.push({ text: text.slice(0, 40), ratio: (Math.max(one, two) + 0.05) / (Math.min(one, two) + 0.05),
      large: size >= 24 || (bold && size >= 18.66) });
  }
  return measured;
})()
"""


def texts(page: Page) -> list[dict[str, Any]]:
    """What is written on a page and seen: text, ratio of contrast, and whether it is large."""
    return page.run(_MEASURE.replace("BEHIND", str(list(BEHIND))))


def faint(page: Page) -> list[str]:
    """Texts that are too faint, with their ratio."""
    return [
        f"{each['text']!r}: {each['ratio']:.2f}"
        for each in texts(page)
        if each["ratio"] < (LEAST_LARGE if each["large"] else LEAST)
    ]
