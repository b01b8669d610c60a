// Map and timeline, drawn by Plotly from the numbers in the page. Texts of the run never become markup.
// Plotly is large: it stands in the page as text, and is run once all the rest has been shown.
(function () {
  "use strict";
  const scene = JSON.parse(document.getElementById("scene").textContent);
  let started = false;
  const colours = { ink: "#1a1a1a", true: "#56B4E9", estimate: "#D55E00", path: "#56B4E9", road: "#c9c9c9" };
  const episodes = {
    distraction: { label: "distraction", key: "D", fill: "#E69F00" },
    microsleep: { label: "microsleep", key: "M", fill: "#CC79A7" },
    lane_change_signalled: { label: "lane change", key: "L", fill: "#dedede" },
    lane_change_unsignalled: { label: "lane change without signal", key: "U", fill: "#b5b5b5" },
  };
  const kinds = {
    fcw: { label: "rear-end warning", colour: "#E69F00", symbol: "triangle-up" },
    ldw: { label: "lane-departure warning", colour: "#0072B2", symbol: "circle" },
    departure: { label: "departure", colour: "#D55E00", symbol: "x" },
  };
  const config = {
    responsive: true,
    displaylogo: false,
    displayModeBar: window.innerWidth >= 700,
    modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
  };
  const font = { family: "system-ui, -apple-system, Segoe UI, Roboto, Arial, sans-serif", size: 13, color: colours.ink };
  const mapElement = document.getElementById("map");
  const timelineElement = document.getElementById("timeline");
  const choice = document.getElementById("vehicle");
  const narrow = () => window.innerWidth < 700;

  // Plotly reads a little HTML in texts: an id is shown as it is written
  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

  function broken(values, breaks) {
    const out = [];
    let next = 0;
    values.forEach((value, i) => {
      if (breaks[next] === i) {
        out.push(null);
        next += 1;
      }
      out.push(value);
    });
    return out;
  }

  function pathOf(id) {
    const found = scene.paths.find((path) => path.id === id);
    return found ? { x: found.x, y: found.y } : { x: [], y: [] };
  }

  function drawMap(id) {
    const all = { x: [], y: [] };
    for (const path of scene.paths) {
      for (const axis of ["x", "y"]) for (const value of path[axis]) all[axis].push(value);
    }
    const line = (data, name, color, width, more) =>
      Object.assign({ type: "scatter", mode: "lines", name, x: data.x, y: data.y, hoverinfo: "skip", line: { color, width } }, more);
    const traces = [
      line(scene.outline, "network", colours.road, 1.2, { visible: scene.outline.x.length > 0, showlegend: scene.outline.x.length > 0 }),
      line(all, "equipped vehicles", colours.path, 1.5),
      line(pathOf(id), "chosen vehicle", colours.ink, 2.5),
    ];
    for (const events of scene.events) {
      const kind = kinds[events.kind];
      traces.push({
        type: "scatter",
        mode: "markers",
        name: `${kind.label} (${events.x.length})`,
        x: events.x,
        y: events.y,
        text: events.vehicle.map((vehicle, i) => `${plain(vehicle)}<br>${events.time[i]} s: ${plain(events.text[i])}`),
        customdata: events.vehicle.map((vehicle, i) => [vehicle, events.time[i]]),
        hovertemplate: `%{text}<extra>${kind.label}</extra>`,
        marker: { size: 11, symbol: kind.symbol, color: kind.colour, line: { color: "#fff", width: 1 } },
      });
    }
    const layout = {
      font,
      height: narrow() ? 420 : 440,
      margin: { l: 55, r: 10, t: 10, b: narrow() ? 190 : 95 },
      hovermode: "closest",
      dragmode: narrow() ? false : "pan",
      xaxis: { title: { text: "x in m" }, zeroline: false, gridcolor: "#ededed" },
      yaxis: { title: { text: "y in m" }, zeroline: false, gridcolor: "#ededed", scaleanchor: "x" },
      legend: { orientation: "h", yref: "container", y: 0, yanchor: "bottom" },
    };
    Plotly.newPlot(mapElement, traces, layout, config);
    mapElement.on("plotly_click", (event) => {
      const data = event.points[0].customdata;
      if (!data) return;
      choose(data[0]);
      window.dispatchEvent(new CustomEvent("moment", { detail: { vehicle: data[0], time: data[1] } }));
    });
  }

  function timelineTraces(vehicle) {
    const columns = vehicle.columns;
    const time = broken(columns.time, vehicle.breaks);
    const line = (name, values, axis, color, dash, width, more) =>
      Object.assign(
        {
          type: "scatter", mode: "lines", name, x: time, y: broken(values, vehicle.breaks), yaxis: axis,
          line: { color, dash, width }, hovertemplate: "%{y}", legendgroup: name,
        },
        more,
      );
    const half = columns.width.map((width) => (width === null ? null : width / 2));
    const border = half.find((value) => value !== null) || 1.8;
    const crossed = vehicle.departures;
    return [
      line("lane borders", half, "y", colours.ink, "solid", 1.5, { hoverinfo: "skip", hovertemplate: undefined }),
      line("lane borders", half.map((value) => (value === null ? null : -value)), "y", colours.ink, "solid", 1.5,
        { showlegend: false, hoverinfo: "skip", hovertemplate: undefined }),
      line("true", columns.offset, "y", colours.true, "solid", 4),
      line("estimated", columns.camera, "y", colours.estimate, "dash", 1.5),
      {
        type: "scatter", mode: "markers", name: "crosses a border", yaxis: "y",
        x: crossed.map((one) => one[1]), y: crossed.map((one) => (one[0] === "left" ? border : -border)),
        text: crossed.map((one) => plain(String(one[2] || "").replace(/_/g, " "))),
        hovertemplate: "%{text}", marker: { symbol: "x", size: 10, color: colours.ink },
      },
      line("true", columns.tlc, "y2", colours.true, "solid", 4, { showlegend: false }),
      line("estimated", columns.foreseen, "y2", colours.estimate, "dash", 1.5, { showlegend: false }),
      line("true", columns.ttc, "y3", colours.true, "solid", 4, { showlegend: false }),
      line("estimated", columns.radar, "y3", colours.estimate, "dash", 1.5, { showlegend: false }),
    ];
  }

  function shading(vehicle) {
    const shapes = [];
    const span = (from, to, axis, fillcolor, opacity, text) =>
      shapes.push({
        type: "rect", layer: "below", x0: from, x1: to, y0: 0, y1: 1, xref: "x", yref: `${axis} domain`,
        fillcolor, opacity, line: { width: 0 },
        label: text ? { text, textposition: "bottom center", font: { size: 11, color: colours.ink } } : undefined,
      });
    for (const [cause, from, to] of vehicle.episodes) {
      span(from, to + 0.1, "y", episodes[cause].fill, 0.55, episodes[cause].key);
    }
    for (const [kind, level, , , from, to] of vehicle.warnings) {
      for (const axis of kind === "ldw" ? ["y", "y2"] : ["y3"]) {
        span(from, to + 0.1, axis, level === "reminder" ? "#F0E442" : "#D55E00", 0.4, axis === "y" ? "" : level === "reminder" ? "R" : "W");
      }
    }
    return shapes;
  }

  function timelineLayout(vehicle) {
    const small = narrow();
    const axis = (text, domain, range) => ({ title: { text, font: { size: 12 } }, domain, range, zeroline: false, gridcolor: "#ededed" });
    return {
      font,
      height: small ? 600 : 640,
      margin: { l: 60, r: 10, t: 10, b: small ? 115 : 85 },
      hovermode: "x unified",
      dragmode: small ? false : "zoom",
      xaxis: { title: { text: "SUMO time in s" }, gridcolor: "#ededed", zeroline: false, anchor: "y3", autorange: true },
      yaxis: axis("left of lane centre in m", [0.5, 1], [-2.6, 2.6]),
      yaxis2: axis("TLC in s", [0.26, 0.45], [0, 3]),
      yaxis3: axis("TTC in s", [0, 0.2], [0, 10]),
      legend: { orientation: "h", yref: "container", y: 0, yanchor: "bottom" },
      shapes: shading(vehicle),
      uirevision: vehicle.id,
    };
  }

  const cursor = document.createElement("div");
  cursor.className = "cursor";
  cursor.hidden = true;
  let moment = null;

  function placeCursor() {
    if (!started) return;
    const size = timelineElement._fullLayout && timelineElement._fullLayout._size;
    cursor.hidden = true;
    if (!size || !moment || moment.vehicle !== choice.value) return;
    const axis = timelineElement._fullLayout.xaxis;
    const x = axis.l2p(moment.time);
    if (x < 0 || x > size.w) return;
    cursor.style.left = `${size.l + x}px`;
    cursor.style.top = `${size.t}px`;
    cursor.style.height = `${size.h}px`;
    cursor.hidden = false;
  }

  function drawTimeline(id) {
    const vehicle = scene.vehicles.find((one) => one.id === id);
    if (!vehicle) return;
    Plotly.react(timelineElement, timelineTraces(vehicle), timelineLayout(vehicle), config);
    if (!cursor.isConnected) {
      timelineElement.appendChild(cursor);
      timelineElement.on("plotly_afterplot", placeCursor);
      timelineElement.on("plotly_click", (event) => {
        window.dispatchEvent(new CustomEvent("moment", { detail: { vehicle: choice.value, time: event.points[0].x } }));
      });
    }
    placeCursor();
  }

  function choose(id) {
    if (!started || !scene.vehicles.some((one) => one.id === id)) return;
    choice.value = id;
    Plotly.restyle(mapElement, { x: [pathOf(id).x], y: [pathOf(id).y] }, [2]);
    drawTimeline(id);
  }

  function explain() {
    const list = document.getElementById("timeline-legend");
    const entry = (colour, text) => {
      const item = document.createElement("li");
      const swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = colour;
      item.append(swatch, text);
      list.append(item);
    };
    for (const one of Object.values(episodes)) entry(one.fill, `${one.key}: ${one.label}`);
    entry("#ee9a66", "W: warning (lane departure, rear-end danger)");
    entry("#f7f0a0", "R: rear-end reminder");
  }

  for (const vehicle of scene.vehicles) {
    const option = document.createElement("option");
    option.value = vehicle.id;
    const events = vehicle.warnings.length + vehicle.departures.length;
    option.textContent = events ? `${vehicle.id} (${events} events)` : vehicle.id;
    choice.append(option);
  }
  const first = scene.vehicles[0].id;
  explain();

  function start() {
    if (started) return;
    started = true;
    const script = document.createElement("script");
    script.textContent = document.getElementById("plotly").textContent;
    document.head.append(script); // runs it; the page's policy knows its hash
    drawMap(first);
    drawTimeline(choice.value);
    choice.addEventListener("change", () => choose(choice.value));
    document.documentElement.dataset.plots = "drawn";
    performance.mark("plots");
  }

  window.addEventListener("load", () => window.setTimeout(start, 50));
  window.addEventListener("viewed", (event) => {
    moment = event.detail;
    placeCursor();
  });
  const folded = () => Array.from(document.querySelectorAll("main details"));
  let before = null;
  window.addEventListener("beforeprint", () => {
    start();
    before = { widths: [mapElement.offsetWidth, timelineElement.offsetWidth], open: folded().map((one) => one.open) };
    folded().forEach((one) => (one.open = true));
    for (const element of [mapElement, timelineElement]) Plotly.relayout(element, { width: 680, "margin.b": 120 });
  });
  window.addEventListener("afterprint", () => {
    if (!before) return;
    folded().forEach((one, i) => (one.open = before.open[i]));
    [mapElement, timelineElement].forEach((element, i) => Plotly.relayout(element, { width: before.widths[i], "margin.b": 95, autosize: true }));
  });
})();
