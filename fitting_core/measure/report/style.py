"""The page's looks: one set of colours for light and one for dark, both readable with red-green blindness."""

STYLES = {
    "SMPLify-X": "red",
    "paper, phase 1": "violet dashed",
    "paper": "violet",
    "tcfit, phase 1": "blue dashed",
    "tcfit": "blue",
    "phase 1": "red",
    "final": "blue",
    "truth": "truth",
}
"""Classes of methods' colours and strokes; the truth stands beside them."""
_MORE = ("teal", "amber", "pink", "grey")


def style_of(method: str, methods: list[str]) -> str:
    """The class of a method; those without a colour of their own take the next free one."""
    if method in STYLES:
        return STYLES[method]
    others = [name for name in methods if name not in STYLES]
    return _MORE[others.index(method) % len(_MORE)]


CSS = """
:root { color-scheme: light dark; --ground: #fff; --panel: #f6f7f9; --ink: #1c2330; --dim: #5d6675; --rule: #dde1e7;
  --red: #c8412f; --blue: #1f6fd6; --violet: #8250c4; --teal: #0f8a84; --amber: #b27700; --pink: #c2408c;
  --grey: #6b7480; --truth: #1c2330; --good: #17803f; --bad: #b3372a; --best: #e4f3e9; }
@media (prefers-color-scheme: dark) { :root { --ground: #12161d; --panel: #1a2029; --ink: #e6e9ee; --dim: #98a2b1;
  --rule: #2e3744; --red: #ff7a66; --blue: #6ab0ff; --violet: #bd95f2; --teal: #4fc7be; --amber: #e3b04b;
  --pink: #f08cc4; --grey: #9aa4b2; --truth: #f0f2f5; --good: #63c98a; --bad: #ff8c7e; --best: #173324; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif; }
main { max-width: 1240px; margin: 0 auto; padding: 28px 24px 64px; }
h1 { font-size: 27px; line-height: 1.2; margin: 0 0 4px; letter-spacing: -0.01em; }
h2 { font-size: 19px; margin: 44px 0 4px; padding-top: 14px; border-top: 1px solid var(--rule); }
h3 { font-size: 14px; margin: 18px 0 2px; font-weight: 600; }
p { margin: 4px 0 10px; max-width: 84ch; }
p.dim, .dim { color: var(--dim); }
a { color: var(--blue); }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(230px, 1fr)); gap: 12px; margin: 20px 0 8px; }
.card { background: var(--panel); border-radius: 10px; padding: 14px 16px; }
.card b { display: block; font-size: 22px; font-weight: 650; letter-spacing: -0.01em; line-height: 1.25;
  font-variant-numeric: tabular-nums; }
.card span { color: var(--dim); font-size: 13px; display: block; }
.card i { font-style: normal; font-size: 15px; font-weight: 500; color: var(--dim); }
.card em { white-space: nowrap; font-style: normal; color: var(--good); font-size: 14px; font-weight: 600;
  margin-left: 6px; }
.card em.worse { color: var(--bad); }
.scroll { overflow-x: auto; margin: 8px 0 14px; }
table { border-collapse: collapse; font-size: 13.5px; font-variant-numeric: tabular-nums; }
th, td { padding: 5px 12px 5px 0; text-align: left; border-bottom: 1px solid var(--rule); white-space: nowrap; }
th { color: var(--dim); font-weight: 600; vertical-align: bottom; }
th.n, td.n { text-align: right; padding: 5px 9px; }
td.best { background: var(--best); font-weight: 650; }
td.head { color: var(--dim); font-weight: 600; padding-top: 16px; }
tr.quiet td { color: var(--dim); font-style: italic; }
.row { display: flex; flex-wrap: wrap; gap: 14px 28px; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(340px, 1fr)); gap: 14px 20px; }
.pair { grid-template-columns: repeat(auto-fill, minmax(min(100%, 500px), 1fr)); }
figure { margin: 0; }
figcaption { font-size: 13px; font-weight: 600; margin-bottom: 2px; }
figcaption span { color: var(--dim); font-weight: 400; }
svg.plot { width: 100%; height: auto; display: block; overflow: visible; }
svg text { font: 11px system-ui, sans-serif; fill: var(--dim); font-variant-numeric: tabular-nums; }
svg text.title { font-weight: 600; }
svg line.grid { stroke: var(--rule); stroke-width: 1; }
svg line.axis { stroke: var(--dim); stroke-width: 1; }
svg .line { fill: none; stroke-width: 1.7; stroke-linejoin: round; stroke-linecap: round; }
svg .dashed { stroke-dasharray: 5 4; stroke-width: 1.4; }
svg .fill.dashed { fill-opacity: 0.38; stroke-dasharray: none; }
svg .truth.line { stroke-width: 1.3; stroke-dasharray: 1.5 3.5; }
.line.red { stroke: var(--red); } .fill.red { fill: var(--red); }
.line.blue { stroke: var(--blue); } .fill.blue { fill: var(--blue); }
.line.violet { stroke: var(--violet); } .fill.violet { fill: var(--violet); }
.line.teal { stroke: var(--teal); } .fill.teal { fill: var(--teal); }
.line.amber { stroke: var(--amber); } .fill.amber { fill: var(--amber); }
.line.pink { stroke: var(--pink); } .fill.pink { fill: var(--pink); }
.line.grey { stroke: var(--grey); } .fill.grey { fill: var(--grey); }
.line.truth { stroke: var(--truth); } .fill.truth { fill: var(--truth); }
.legend { display: flex; flex-wrap: wrap; gap: 4px 20px; font-size: 13px; color: var(--ink); margin: 6px 0; }
.legend span { display: inline-flex; align-items: center; gap: 7px; }
.legend svg { width: 26px; height: 13px; } .legend .line { stroke-width: 2.6; }
.worst { display: grid; grid-template-columns: repeat(auto-fill, minmax(520px, 1fr)); gap: 22px; }
.views { display: flex; gap: 4px; border-radius: 8px; overflow: hidden; }
.views div { flex: 1; min-width: 0; background: #eceff3; color: #39424f; font-size: 12px; text-align: center; }
.views img { width: 100%; display: block; } .views b { display: block; padding: 5px 2px 0; font-weight: 600; }
details { margin: 10px 0; } summary { cursor: pointer; font-weight: 600; color: var(--dim); }
code { font: 12.5px ui-monospace, "SF Mono", Menlo, Consolas, monospace; overflow-wrap: anywhere; }
@media (max-width: 600px) { main { padding: 18px 14px 48px; } .worst { grid-template-columns: 1fr; } }
@media print { h2 { break-after: avoid; } figure { break-inside: avoid; } }
"""
