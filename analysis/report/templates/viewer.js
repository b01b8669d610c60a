// The drive viewer: a camera picture and a view from above, drawn on canvases from the numbers in the page.
(function () {
  "use strict";
  const drives = Array.from(document.querySelectorAll('script[id^="drive-data-"]'), (holder) => JSON.parse(holder.textContent));
  if (!drives.length) return;
  const get = (id) => document.getElementById(id);
  const camera = get("camera").getContext("2d");
  const above = get("birdseye").getContext("2d");
  const slider = get("slider");
  const classes = {
    unclassified: { label: "unclassified", colour: "#595959", shape: "ring" },
    stationary: { label: "stationary", colour: "#404040", shape: "square" },
    same_direction: { label: "same direction", colour: "#0072B2", shape: "circle" },
    oncoming: { label: "oncoming", colour: "#D55E00", shape: "triangle" },
    stopped_was_same_direction: { label: "stopped, was same direction", colour: "#56B4E9", shape: "diamond" },
    stopped_was_oncoming: { label: "stopped, was oncoming", colour: "#E69F00", shape: "cross" },
  };
  const WIDEN = 3; // metres across are drawn so much larger than metres ahead
  let drive = drives[0];
  let index = 0;
  let timer = null;
  let ticket = 0;
  const pictures = new Map();

  function picture(step) {
    let image = pictures.get(step);
    if (!image) {
      image = new Image();
      image.src = `data:image/jpeg;base64,${step.picture}`;
      pictures.set(step, image);
      if (pictures.size > 60) pictures.delete(pictures.keys().next().value);
    }
    return image;
  }

  function line(context, points, colour, width, dashes) {
    if (points.length < 2) return;
    context.beginPath();
    points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.setLineDash(dashes || []);
    context.strokeStyle = "rgba(255, 255, 255, 0.85)"; // so that it shows on dark and bright road alike
    context.lineWidth = width + 2;
    context.stroke();
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke();
    context.setLineDash([]);
  }

  function drawCamera(step, image) {
    const canvas = camera.canvas;
    const scale = canvas.width / drive.width;
    camera.imageSmoothingEnabled = true;
    if (image && image.naturalWidth) camera.drawImage(image, 0, 0, canvas.width, canvas.height);
    else camera.clearRect(0, 0, canvas.width, canvas.height);
    const scaled = (points) => points.map(([x, y]) => [x * scale, y * scale]);
    line(camera, scaled(step.path), "#B8860B", 4, [10, 6]);
    line(camera, scaled(step.borders[0]), "#D55E00", 4);
    line(camera, scaled(step.borders[1]), "#009E73", 4);
  }

  function view() {
    const canvas = above.canvas;
    const ahead = Number(get("reach").value);
    const behind = ahead * 0.1;
    const metre = canvas.height / (ahead + behind);
    // ahead is up, left is left
    return { metre, behind, ahead, place: (x, y) => [canvas.width / 2 - y * metre * WIDEN, (ahead - x) * metre] };
  }

  function outline(context, frame, x, y, heading, length, width) {
    const cos = Math.cos(heading), sin = Math.sin(heading);
    context.beginPath();
    [[1, 1], [1, -1], [-1, -1], [-1, 1]].forEach(([a, b], i) => {
      const forward = (a * length) / 2, left = (b * width) / 2;
      const [px, py] = frame.place(x + cos * forward - sin * left, y + sin * forward + cos * left);
      if (i) context.lineTo(px, py);
      else context.moveTo(px, py);
    });
    context.closePath();
  }

  function mark(context, x, y, size, look, solid) {
    context.beginPath();
    if (look.shape === "square") context.rect(x - size, y - size, 2 * size, 2 * size);
    else if (look.shape === "triangle") {
      context.moveTo(x, y + size * 1.2);
      context.lineTo(x - size * 1.1, y - size * 0.8);
      context.lineTo(x + size * 1.1, y - size * 0.8);
      context.closePath();
    } else if (look.shape === "diamond") {
      context.moveTo(x, y - size * 1.3);
      context.lineTo(x + size * 1.3, y);
      context.lineTo(x, y + size * 1.3);
      context.lineTo(x - size * 1.3, y);
      context.closePath();
    } else if (look.shape === "cross") {
      context.rect(x - size * 1.2, y - size * 0.4, size * 2.4, size * 0.8);
      context.rect(x - size * 0.4, y - size * 1.2, size * 0.8, size * 2.4);
    } else context.arc(x, y, size, 0, 2 * Math.PI);
    context.lineWidth = 2;
    context.strokeStyle = look.colour;
    context.fillStyle = look.shape === "ring" || !solid ? "#fff" : look.colour;
    context.fill();
    context.stroke();
  }

  function scaleBar(frame) {
    above.fillStyle = "#595959";
    above.font = "13px system-ui, sans-serif";
    above.strokeStyle = "#e3e3e3";
    above.lineWidth = 1;
    const every = frame.ahead > 60 ? 20 : 10;
    for (let x = 0; x < frame.ahead; x += every) {
      const [, y] = frame.place(x, 0);
      above.beginPath();
      above.moveTo(0, y);
      above.lineTo(above.canvas.width, y);
      above.stroke();
      above.fillText(`${x} m`, 4, y - 3);
    }
  }

  function drawAbove(step) {
    const frame = view();
    above.clearRect(0, 0, above.canvas.width, above.canvas.height);
    scaleBar(frame);
    for (const [kind, points] of step.road) {
      above.beginPath();
      points.forEach(([x, y], i) => {
        const [px, py] = frame.place(x, y);
        if (i) above.lineTo(px, py);
        else above.moveTo(px, py);
      });
      above.setLineDash(kind === 2 ? [10, 10] : []);
      above.strokeStyle = "#8a8a8a";
      above.lineWidth = 2;
      above.stroke();
      above.setLineDash([]);
    }
    for (const [x, y, heading, length, width] of step.bodies) {
      outline(above, frame, x, y, heading, length, width);
      above.strokeStyle = "#9a9a9a";
      above.fillStyle = "rgba(0, 0, 0, 0.06)";
      above.lineWidth = 1.5;
      above.fill();
      above.stroke();
    }
    outline(above, frame, 0, 0, 0, 4.3, 1.8);
    above.fillStyle = "#1a1a1a";
    above.fill();
    line(above, [[0, 0], ...step.ground].map(([x, y]) => frame.place(x, y)), "#B8860B", 3, [8, 5]);
    let target = null;
    for (const track of step.tracks) {
      const [ahead, left, state, inPath, measured, ttc] = track;
      if (ahead === null || left === null) continue;
      const [x, y] = frame.place(ahead, left);
      mark(above, x, y, 6, classes[drive.classes[state]] || classes.unclassified, measured);
      if (inPath && (!target || ahead < target.x)) target = { x: ahead, y: left, ttc };
    }
    if (target) {
      const [x, y] = frame.place(target.x, target.y);
      above.beginPath();
      above.arc(x, y, 13, 0, 2 * Math.PI);
      above.strokeStyle = "#1a1a1a";
      above.lineWidth = 3;
      above.stroke();
      const text = target.ttc === null ? "target in path" : `target, TTC ${target.ttc.toFixed(1)} s`;
      above.font = "bold 14px system-ui, sans-serif";
      const width = above.measureText(text).width;
      const left = Math.min(x + 18, above.canvas.width - width - 6);
      above.fillStyle = "rgba(255, 255, 255, 0.85)";
      above.fillRect(left - 3, y - 14, width + 6, 19);
      above.fillStyle = "#1a1a1a";
      above.fillText(text, left, y);
    }
  }

  function tell(step) {
    const near = step.tlc === null ? 0 : Math.max(0, 1 - step.tlc / 2);
    const bar = get("tlc-bar");
    bar.firstElementChild.style.width = `${100 * near}%`;
    bar.classList.toggle("near", step.tlc !== null && step.tlc < 1);
    bar.setAttribute("aria-valuenow", step.tlc === null ? 2 : Math.min(step.tlc, 2));
    get("tlc-text").textContent = step.tlc === null ? "none foreseen in 2 s" : `${step.tlc.toFixed(2)} s, ${step.side}`;
    const number = (value, unit, decimals) => (value === null ? "–" : `${value.toFixed(decimals)} ${unit}`);
    const facts = [
      ["Speed", number(step.speed, "m/s", 1), false],
      ["Left of lane centre", number(step.offset, "m", 2), false],
      ["Lane-departure warning", step.lane || "–", step.lane.startsWith("warning")],
      ["Rear-end warning", step.rear || "–", step.rear === "danger" || step.rear === "reminder"],
      ["Gap to target", number(step.gap, "m", 1), false],
      ["Time to collision", number(step.ttc, "s", 1), false],
    ];
    const list = get("readout");
    if (list.children.length !== facts.length) {
      list.replaceChildren(...facts.map(([name]) => {
        const row = document.createElement("div");
        row.append(document.createElement("dt"), document.createElement("dd"));
        row.firstElementChild.textContent = name;
        return row;
      }));
    }
    facts.forEach(([, value, alert], i) => {
      const cell = list.children[i].lastElementChild;
      cell.textContent = value;
      cell.classList.toggle("alert", alert);
    });
  }

  function show(to) {
    index = Math.max(0, Math.min(to, drive.steps.length - 1));
    const step = drive.steps[index];
    const mine = (ticket += 1);
    slider.value = index;
    get("now").textContent = `${step.time.toFixed(1)} s`;
    slider.setAttribute("aria-valuetext", `${step.time.toFixed(1)} seconds`);
    drawAbove(step);
    tell(step);
    const image = picture(step);
    const finish = () => {
      if (mine !== ticket) return; // the slider has moved on
      drawCamera(step, image);
      slider.dataset.drawn = String(index);
    };
    if (image.complete && image.naturalWidth) finish();
    else image.decode().then(finish, finish);
    if (index + 1 < drive.steps.length) picture(drive.steps[index + 1]);
    window.dispatchEvent(new CustomEvent("viewed", { detail: { vehicle: drive.vehicle, time: step.time } }));
  }

  function stop() {
    window.clearInterval(timer);
    timer = null;
    get("play").textContent = "Play";
    get("play").setAttribute("aria-pressed", "false");
  }

  function start() {
    if (index >= drive.steps.length - 1) show(0);
    const wait = (100 * drive.every) / Number(get("rate").value);
    timer = window.setInterval(() => {
      if (index >= drive.steps.length - 1) stop();
      else show(index + 1);
    }, wait);
    get("play").textContent = "Pause";
    get("play").setAttribute("aria-pressed", "true");
  }

  function explain() {
    const list = get("track-legend");
    const entry = (draw, text) => {
      const item = document.createElement("li");
      const canvas = document.createElement("canvas");
      canvas.width = canvas.height = 36;
      canvas.setAttribute("aria-hidden", "true");
      draw(canvas.getContext("2d"));
      item.append(canvas, text);
      list.append(item);
    };
    for (const look of Object.values(classes)) entry((context) => mark(context, 18, 18, 9, look, true), look.label);
    entry((context) => mark(context, 18, 18, 9, classes.same_direction, false), "not measured in this scan");
    entry((context) => {
      mark(context, 18, 18, 7, classes.same_direction, true);
      context.beginPath();
      context.arc(18, 18, 14, 0, 2 * Math.PI);
      context.strokeStyle = "#1a1a1a";
      context.lineWidth = 3;
      context.stroke();
    }, "nearest in path");
  }

  function take(number, time) {
    stop();
    drive = drives[number];
    slider.max = drive.steps.length - 1;
    get("drive-vehicle").value = number;
    get("drive-notes").replaceChildren(...drive.notes.map((note) => {
      const item = document.createElement("li");
      item.textContent = note;
      return item;
    }));
    goTo(time === undefined ? drive.start : time);
  }

  function goTo(time) {
    const at = drive.steps.findIndex((step) => step.time >= time - 0.001);
    show(at < 0 ? drive.steps.length - 1 : at);
  }

  drives.forEach((one, number) => {
    const option = document.createElement("option");
    option.value = number;
    option.textContent = one.vehicle;
    get("drive-vehicle").append(option);
  });
  explain();
  take(0);
  slider.addEventListener("input", () => show(Number(slider.value)));
  get("play").addEventListener("click", () => (timer ? stop() : start()));
  get("rate").addEventListener("change", () => {
    if (timer) {
      stop();
      start();
    }
  });
  get("reach").addEventListener("change", () => show(index));
  get("drive-vehicle").addEventListener("change", () => take(Number(get("drive-vehicle").value)));
  window.addEventListener("moment", (event) => {
    const number = drives.findIndex((one) => one.vehicle === event.detail.vehicle);
    if (number >= 0) take(number, event.detail.time);
  });
})();
