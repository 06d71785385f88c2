"use strict";
/* The charts, drawn by plotly.js. */

const darkness = matchMedia("(prefers-color-scheme: dark)");
const HUES = {healthy: ["#6e7781", "#9aa4af"], now: ["#D55E00", "#FF8A3D"]};

function hue(name) { return HUES[name][darkness.matches ? 1 : 0]; }

function layoutOf(box, height, more) {
  const style = getComputedStyle(document.documentElement);
  const ink = style.getPropertyValue("--ink").trim(), rule = style.getPropertyValue("--rule").trim();
  const axis = {gridcolor: rule, zerolinecolor: rule, linecolor: rule, automargin: true};
  const layout = {
    width: box.clientWidth, height, margin: {l: 56, r: 10, t: 8, b: 40}, showlegend: true,
    legend: {orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: {size: 12}},
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: {color: ink, family: "system-ui, sans-serif", size: 12}, ...more};
  for (const name of ["xaxis", "yaxis", "yaxis2"])
    if (layout[name]) layout[name] = {...axis, ...layout[name]};
  return layout;
}

const CONFIG = {displayModeBar: false, responsive: false};

/* An axis title that stays short enough for a narrow page. */
function titled(text) { return {title: {text, standoff: 6}}; }

function minus(a, b) { return a.map((value, k) => value - b[k]); }

function drawTorque(box, answer) {
  const step = answer.step * answer.period;
  const [usual, now] = [answer.healthy, answer.now].map(one => unpacked(one.torque));
  const line = (name, y, more) => ({type: "scatter", mode: "lines", name, y, x0: 0, dx: step,
    line: {width: 1.5, color: hue(name === "healthy" ? "healthy" : "now")}, ...more});
  Plotly.react(box, [
    line("healthy", usual), line("with the fault", now),
    line("change", minus(now, usual), {yaxis: "y2", showlegend: false, line: {width: 1.1,
      color: hue("now")}}),
  ], layoutOf(box, 380, {
    xaxis: {...titled("time [s]"), anchor: "y2"},
    yaxis: {...titled("torque [N m]"), domain: [0.39, 1]},
    yaxis2: {...titled("change [N m]"), domain: [0, 0.31]},
  }), CONFIG);
}

function drawFriction(box, answer) {
  /* lines are drawn five times as fast as that many points */
  const path = (name, one) => ({type: "scatter", mode: "lines", name,
    x: unpacked(one.velocity), y: unpacked(one.friction),
    line: {width: 1.5, color: hue(name === "healthy" ? "healthy" : "now")}});
  Plotly.react(box, [path("healthy", answer.healthy), path("with the fault", answer.now)],
    layoutOf(box, 270, {xaxis: titled("motor speed [rad/s]"), yaxis: titled("friction [N m]")}),
    CONFIG);
}

function drawBars(box, answer, kind) {
  const [low, high, unit] = answer.bins[kind];
  const width = (high - low) / answer.now.histograms[kind].length;
  const bars = (name, one) => {
    const y = one.histograms[kind];
    return {type: "bar", name, y, x: y.map((_, k) => low + (k + 0.5) * width),
            marker: {color: hue(name === "healthy" ? "healthy" : "now")}};
  };
  Plotly.react(box, [bars("healthy", answer.healthy), bars("with the fault", answer.now)],
    layoutOf(box, 270, {xaxis: titled(unit), yaxis: {...titled("share of the time"),
      tickformat: ".0%"}, bargap: 0.15}), CONFIG);
}
