// The plots of a node's page: uPlot, which only this page loads, in place of the server's pictures. One cursor
// goes through all of them.
(() => {
  "use strict";
  const HEIGHT = 76;
  // As wide as the last column of the lanes with the gap before it, so that plots and strips share their time.
  const AXIS = 212;

  // The edges of a band have no line of their own.
  const EDGE = { width: 0, points: { show: false } };

  // The second node's line differs from the first one, and from limits, without its colour too.
  const DOTS = [2, 3];

  // A chart is made anew for another scale.
  const kind = ({ dataset: { second, sameScale } }) => `${second !== undefined} ${sameScale !== undefined}`;

  const drawn = new Map();
  let loading = null;
  const load = ({ uplot, uplotStyle }) => {
    loading ??= new Promise((done, failed) => {
      const style = Object.assign(document.createElement("link"), { rel: "stylesheet", href: uplotStyle });
      const script = Object.assign(document.createElement("script"), { src: uplot, onload: done, onerror: failed });
      document.head.append(style, script);
    });
    return loading;
  };

  // Asked for at each drawing, so a plot follows the palette.
  const colour = (name) => () => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  const clock = (seconds) => {
    const at = new Date(seconds * 1000);
    return `${at.toTimeString().slice(0, 8)}.${String(at.getMilliseconds()).padStart(3, "0")}`;
  };

  const read = (plot) => {
    const { numbers, least, most, second } = plot.dataset;
    const lanes = plot.closest(".lanes");
    const times = JSON.parse(lanes.dataset.times).map((ms) => ms / 1000);
    return {
      span: [Number(lanes.dataset.start) / 1000, Number(lanes.dataset.end) / 1000],
      limits: JSON.parse(plot.dataset.limits),
      // Minutes and hours have their least and greatest numbers too. The numbers of a second node are last.
      data: [times, ...[numbers, least, most, second].filter(Boolean).map((all) => JSON.parse(all))],
    };
  };

  const drawLimits = (plot) => (chart) => {
    const { ctx, bbox } = chart;
    ctx.save();
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash([5 * devicePixelRatio, 3 * devicePixelRatio]);
    for (const { name, value } of read(plot).limits) {
      const y = chart.valToPos(value, "y", true);
      ctx.strokeStyle = colour(name.startsWith("error") ? "--ring" : "--warning")();
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  };

  // The limits are in the picture, and a number that never changes has a height.
  const range = (plot) => (_chart, least, most) => {
    const all = [least, most, ...read(plot).limits.map(({ value }) => value)].filter(Number.isFinite);
    if (!all.length) return [0, 1];
    const [low, high] = [Math.min(...all), Math.max(...all)];
    const margin = (high - low || Math.abs(high) || 1) * 0.08;
    return [low - margin, high + margin];
  };

  const say = (plot) => (chart) => {
    const { idx, left } = chart.cursor;
    const [number, ...others] = left >= 0 && idx !== null ? chart.data.slice(1).map((all) => all[idx]) : [];
    const second = plot.dataset.second === undefined ? "" : `  | ${others.pop() ?? "-"}`;
    const [least, most] = others;
    const ends = Number.isFinite(least) ? `  ${least} … ${most}` : "";
    const text = number === undefined ? "" : `${clock(chart.data[0][idx])}  ${number ?? "-"}${ends}${second}`;
    Live.setText(plot.querySelector("output"), text);
  };

  const make = (plot) => {
    const host = plot.querySelector(".chart");
    const { second, sameScale, least } = plot.dataset;
    const within = least ? [EDGE, EDGE] : [];
    const dotted = { stroke: colour("--second"), width: 2, dash: DOTS, points: { show: false } };
    const options = {
      width: host.parentElement.clientWidth - host.offsetLeft + host.parentElement.offsetLeft,
      height: HEIGHT,
      padding: [6, 0, 6, 0],
      legend: { show: false },
      cursor: { y: false, sync: { key: "node" }, drag: { x: false, y: false } },
      scales: { x: { range: () => read(plot).span }, y: { range: range(plot) }, own: {} },
      axes: [
        { show: false },
        {
          side: 1, size: AXIS, space: 22, gap: 8, stroke: colour("--quiet"), font: "11.5px Inter, sans-serif",
          grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false },
        },
      ],
      series: [{}, { stroke: colour("--plot"), width: 1.6, points: { show: false } }, ...within,
        ...(second ? [{ ...dotted, scale: sameScale === undefined ? "own" : "y" }] : [])],
      bands: within.length ? [{ series: [3, 2], fill: colour("--band") }] : [],
      hooks: { draw: [drawLimits(plot)], setCursor: [say(plot)] },
    };
    const chart = new uPlot(options, read(plot).data, host);
    chart.kind = kind(plot);
    plot.querySelector("svg").style.display = "none";
    drawn.set(plot, chart);
    fit(plot, chart);
  };

  const fit = (plot, chart) => {
    const width = Math.floor(plot.querySelector(".chart").getBoundingClientRect().width);
    if (width > AXIS && width !== chart.width) chart.setSize({ width, height: HEIGHT });
  };

  const draw = async () => {
    for (const [plot, chart] of drawn) {
      if (plot.isConnected) continue;
      chart.destroy();
      drawn.delete(plot);
    }
    const all = [...document.querySelectorAll(".plot[data-numbers]")];
    if (!all.length) return;
    try {
      await load(all[0].closest(".lanes").dataset);
    } catch {
      // The server's pictures stay.
      return;
    }
    for (const plot of all) {
      const [chart, { data }] = [drawn.get(plot), read(plot)];
      if (chart?.data.length === data.length && chart.kind === kind(plot)) chart.setData(data);
      else if (chart) {
        chart.destroy();
        drawn.delete(plot);
      }
    }
    // A page is painted with the pictures of the server first.
    requestAnimationFrame(() => setTimeout(() => {
      for (const plot of all) if (plot.isConnected && !drawn.has(plot)) make(plot);
    }));
  };

  // The crosshair of the strips goes through the plots too.
  addEventListener("telltale:point", ({ detail: share }) => {
    for (const chart of drawn.values()) chart.setCursor({ left: share * chart.over.clientWidth, top: 1 });
  });
  addEventListener("telltale:shown", draw);
  addEventListener("resize", () => {
    for (const [plot, chart] of drawn) fit(plot, chart);
  });
  draw();
})();
