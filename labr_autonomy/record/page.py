"""The frame of `report.html`: no script, no font and no picture from outside."""

from __future__ import annotations

from string import Template

PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
  content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>$title</title>
<style>
:root { --ink: #22272e; --faint: #6a737d; --line: #e1e4e8; --land: #d9730d; --air: #1668c7;
  --good: #2e7d32; --warn: #a15c00; --bad: #c62828; }
* { box-sizing: border-box; }
body { margin: 0; background: #f4f5f7; color: var(--ink);
  font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; }
main { max-width: 980px; margin: 0 auto; padding: 24px 20px 48px; }
header { background: #fff; border-radius: 10px; border-left: 8px solid var(--tone); padding: 18px 24px 14px; }
header.good { --tone: var(--good); } header.warn { --tone: var(--warn); } header.bad { --tone: var(--bad); }
header small { color: var(--faint); }
h1 { margin: 2px 0 4px; font-size: 27px; line-height: 1.2; color: var(--tone); }
header p { margin: 0; font-size: 17px; }
header p.note, .note { color: var(--bad); font-size: 15px; margin: 6px 0 0; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(118px, 1fr)); gap: 10px; }
.tiles { margin: 14px 0; }
.tile { background: #fff; border-radius: 10px; padding: 10px 14px; border-top: 4px solid var(--line); }
.tile b { display: block; font-size: 22px; font-variant-numeric: tabular-nums; white-space: nowrap; }
.tile span { color: var(--faint); font-size: 13px; }
.tile.land { border-color: var(--land); } .tile.air { border-color: var(--air); }
.tile.bad { border-color: var(--bad); }
section { background: #fff; border-radius: 10px; padding: 14px 24px 18px; margin-top: 14px; }
section { overflow-x: auto; }
h2 { font-size: 17px; margin: 0 0 2px; }
section p { margin: 0 0 8px; color: var(--faint); font-size: 14px; }
img { max-width: 100%; height: auto; display: block; }
section > img { width: 100%; }
.frames { display: grid; grid-template-columns: repeat(auto-fill, minmax(270px, 1fr)); gap: 12px; }
figure { margin: 0; } figure img { width: 100%; border-radius: 6px; }
figcaption { font-size: 13px; color: var(--faint); font-variant-numeric: tabular-nums; }
.bad { color: var(--bad); } .tile.bad b { color: var(--bad); }
.dot { display: inline-block; width: 9px; height: 9px; border-radius: 50%; background: var(--land); }
.dot.air { background: var(--air); border-radius: 0; clip-path: polygon(50% 0, 100% 100%, 0 100%); }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
th, td { padding: 4px 6px; border-bottom: 1px solid var(--line); vertical-align: top; }
th { color: var(--faint); font-weight: 600; }
.word { text-align: left; } td.figure { white-space: nowrap; }
.figure { text-align: right; font-variant-numeric: tabular-nums; }
@media print {
  @page { margin: 12mm; }
  body { background: #fff; font-size: 11pt; print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  main { max-width: none; padding: 0; }
  section, header, .tile { border-radius: 0; padding-left: 10px; padding-right: 0; }
  section { break-inside: avoid; padding-top: 8px; margin-top: 6px; overflow: visible; }
  .frames { grid-template-columns: repeat(3, 1fr); }
  .tiles { grid-template-columns: repeat(7, 1fr); } .tile { padding: 4px 6px; } .tile b { font-size: 15px; }
  .tile span { font-size: 9pt; }
}
</style>
</head>
<body>
<main>
<header class="$kind">
<small>$mission &middot; $run</small>
<h1>$headline</h1>
<p>$reason</p>
$notes
</header>
<div class="tiles">$tiles</div>
$sections
</main>
</body>
</html>
""")
