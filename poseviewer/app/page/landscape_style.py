"""How the grid of maps looks. All names begin with ``pv-``: the page around it has its own."""

STYLE = """
.pv-land{display:grid;gap:3px;padding:0 6px 10px 4px;font-size:11px;line-height:1.25;color:inherit}
.pv-cell{position:relative;aspect-ratio:1;border-radius:2px;overflow:hidden}
.pv-none{background:rgba(255,255,255,.05)}
.pv-cell>svg{display:block;width:100%;height:100%;cursor:crosshair;touch-action:none;
transition:filter .15s,opacity .15s}
.pv-dim .pv-cell>svg{opacity:.55;filter:saturate(.35)}
.pv-land path,.pv-land polyline,.pv-land polygon,.pv-land circle,.pv-land use{fill:none;
vector-effect:non-scaling-stroke;stroke-linejoin:round;stroke-linecap:round}
.pv-cell polyline{stroke:#16181d;stroke-width:2.6px;stroke-opacity:.7}
.pv-land .pv-trail{stroke:#fff;stroke-width:1.2px;stroke-opacity:1}
.pv-land .pv-simplex{stroke:#fff;stroke-width:1.2px;fill:rgba(22,24,29,.55)}
.pv-land .pv-least{stroke:#16181d;stroke-width:1.2px;fill:#fff}
.pv-land .pv-pose path{stroke:#ff2d55;stroke-width:2px}
.pv-land .pv-pose .pv-halo{stroke:#16181d;stroke-width:4px;stroke-opacity:.75}
.pv-beside{opacity:.55}
.pv-row{align-self:center;text-align:right;padding-right:2px}
.pv-turned{writing-mode:vertical-rl;transform:rotate(180deg);justify-self:end;padding:2px 0 0}
.pv-col{text-align:center;align-self:start;white-space:nowrap}
.pv-cell button{position:absolute;top:1px;right:1px;width:18px;height:18px;padding:0;border:0;
border-radius:3px;background:rgba(22,24,29,.75);color:#d7dae0;font:12px/18px sans-serif;
cursor:pointer;opacity:0}
.pv-cell:hover button,.pv-cell button:focus-visible{opacity:1}
@media (hover:none){.pv-cell button{opacity:.7}}
.pv-key{grid-area:1/4/3/-1;padding:2px 2px 0 12px}
.pv-bar{height:8px;border-radius:2px;margin:4px 0 2px}
.pv-ends{display:flex;justify-content:space-between;font-variant-numeric:tabular-nums}
.pv-marks{display:grid;grid-template-columns:repeat(auto-fill,minmax(92px,1fr));gap:2px 8px;
margin-top:6px}
.pv-marks span{display:flex;align-items:center;gap:5px;white-space:nowrap}
.pv-marks svg{width:16px;height:16px;flex:none}
""".strip().replace("\n", "")
