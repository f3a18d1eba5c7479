"use strict";
// Many designs: a scatter of any two columns, and all columns as parallel axes on which a range can be brushed.
(function () {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const ink = () => (dark.matches ? "#e5e7eb" : "#1f2937"), faint = () => (dark.matches ? "#374151" : "#d1d5db");
  const COLOURS = { met: "#0072B2", violated: "#D55E00" }, OTHER = "#9aa3b2";
  function add(parent, tag, style, text) {
    const found = parent.appendChild(document.createElement(tag));
    if (style) { found.className = style; }
    if (text !== undefined) { found.textContent = text; }
    return found;
  }
  function unpack(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k += 1) { bytes[k] = raw.charCodeAt(k); }
    return new Float32Array(bytes.buffer);
  }
  function told(value) {
    const size = Math.abs(value);
    if (value === 0) { return "0"; }
    return size >= 1e5 || size < 1e-3 ? value.toExponential(2) : String(Number(value.toPrecision(3)));
  }
  // Where a value lies on its axis, from 0 to 1: by the logarithm where values span decades.
  function scale(column) {
    let low = Infinity, high = -Infinity;
    column.values.forEach((v) => { if (Number.isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); } });
    const isLog = !column.levels && low > 0 && high / low > 20;
    const room = column.levels ? 0.5 : 0, a = isLog ? Math.log(low) : low - room, b = isLog ? Math.log(high) : high + room;
    column.part = (v) => ((isLog ? Math.log(v) : v) - a) / (b - a || 1);
    column.at = (part) => { const v = a + part * (b - a); return isLog ? Math.exp(v) : v; };
    column.title = column.unit ? `${column.name} (${column.unit})` : column.name;
    column.ticks = column.levels
      ? column.levels.map((name, k) => [column.part(k), name])
      : [0, 0.25, 0.5, 0.75, 1].map((part) => [part, told(column.at(part))]);
  }
  function canvas(parent, height) {
    const found = add(parent, "canvas"), c = found.getContext("2d");
    found.style.width = "100%";
    found.style.height = `${height}px`;
    return { node: found, c, size: () => {
      const ratio = devicePixelRatio || 1, width = found.clientWidth || 800;
      found.width = width * ratio;
      found.height = height * ratio;
      c.setTransform(ratio, 0, 0, ratio, 0, 0);
      c.font = '11px "DejaVu Sans", Arial, sans-serif';
      return [width, height];
    } };
  }

  function explore(holder) {
    const data = JSON.parse(holder.querySelector("script").textContent);
    const columns = data.columns, count = data.count;
    columns.forEach((column) => { column.values = unpack(column.values); scale(column); });
    const ranges = new Map();  // brushed part of an axis, by column
    let kept = new Uint8Array(count).fill(1), chosen = -1;
    const verdict = data.verdicts, words = data.words;
    const colour = (k) => COLOURS[words[verdict[k]]] || OTHER;

    const controls = add(holder, "p", "controls");
    function select(label, first) {
      add(controls, "label", "", `${label} `);
      const found = add(controls, "select");
      found.setAttribute("aria-label", label);
      columns.forEach((column, k) => { const one = add(found, "option", "", column.title); one.value = k; });
      found.value = first;
      found.addEventListener("change", draw);
      return found;
    }
    const xs = select("across", data.x), ys = select(" up", data.y);
    const clear = add(controls, "button", "", "all designs");
    clear.type = "button";
    const said = add(holder, "p", "said"), one = add(holder, "pre", "chosen");
    said.setAttribute("aria-live", "polite");
    const scatter = canvas(holder, 360), axes = canvas(holder, 380);
    scatter.node.setAttribute("role", "img");
    scatter.node.setAttribute("aria-label", "scatter of the designs; a click names the nearest one");
    axes.node.setAttribute("role", "img");
    axes.node.setAttribute("aria-label", "designs over parallel axes; drag along an axis to keep a range");
    const BOX = { left: 62, right: 14, top: 10, bottom: 40 }, LINES = { left: 110, right: 90, top: 118, bottom: 12 };

    function keep() {
      kept.fill(1);
      ranges.forEach(([low, high], k) => {
        const column = columns[k];
        for (let n = 0; n < count; n += 1) {
          const part = column.part(column.values[n]);
          if (!(part >= low && part <= high)) { kept[n] = 0; }
        }
      });
    }
    function drawScatter() {
      const [width, height] = scatter.size(), c = scatter.c, x = columns[xs.value], y = columns[ys.value];
      const w = width - BOX.left - BOX.right, h = height - BOX.top - BOX.bottom;
      c.clearRect(0, 0, width, height);
      c.fillStyle = ink();
      c.strokeStyle = faint();
      c.textAlign = "center";
      x.ticks.forEach(([part, text]) => {
        c.fillText(text, BOX.left + part * w, height - BOX.bottom + 14);
        c.strokeRect(BOX.left + part * w, BOX.top, 0, h);
      });
      c.fillText(x.title, BOX.left + w / 2, height - 8);
      c.textAlign = "right";
      y.ticks.forEach(([part, text]) => {
        c.fillText(text, BOX.left - 5, BOX.top + (1 - part) * h + 4);
        c.strokeRect(BOX.left, BOX.top + (1 - part) * h, w, 0);
      });
      c.save();
      c.translate(11, BOX.top + h / 2);
      c.rotate(-Math.PI / 2);
      c.textAlign = "center";
      c.fillText(y.title, 0, 0);
      c.restore();
      const size = count > 3000 ? 2 : 3;
      for (let round = 0; round < 2; round += 1) {
        c.globalAlpha = round ? 0.75 : 0.08;
        for (let n = 0; n < count; n += 1) {
          const a = x.part(x.values[n]), b = y.part(y.values[n]);
          if (kept[n] === round && Number.isFinite(a) && Number.isFinite(b)) {
            c.fillStyle = colour(n);
            c.fillRect(BOX.left + a * w - size / 2, BOX.top + (1 - b) * h - size / 2, size, size);
          }
        }
      }
      c.globalAlpha = 1;
      if (chosen >= 0) {
        c.strokeStyle = ink();
        c.strokeRect(BOX.left + x.part(x.values[chosen]) * w - 5, BOX.top + (1 - y.part(y.values[chosen])) * h - 5, 10, 10);
      }
    }
    const place = (k, width) => LINES.left + k * (width - LINES.left - LINES.right) / Math.max(1, columns.length - 1);
    function drawAxes() {
      const [width, height] = axes.size(), c = axes.c, h = height - LINES.top - LINES.bottom;
      c.clearRect(0, 0, width, height);
      const most = 1500, step = Math.max(1, Math.ceil(kept.reduce((sum, one) => sum + one, 0) / most));
      let seen = 0;
      c.globalAlpha = 0.18;
      c.lineWidth = 0.7;
      for (let n = 0; n < count; n += 1) {
        if (!kept[n] || (seen++ % step)) { continue; }
        c.strokeStyle = colour(n);
        c.beginPath();
        columns.forEach((column, k) => {
          const part = column.part(column.values[n]);
          if (Number.isFinite(part)) { c.lineTo(place(k, width), LINES.top + (1 - part) * h); }
        });
        c.stroke();
      }
      c.globalAlpha = 1;
      c.lineWidth = 1;
      columns.forEach((column, k) => {
        const x = place(k, width);
        c.strokeStyle = ink();
        c.fillStyle = ink();
        c.strokeRect(x, LINES.top, 0, h);
        c.textAlign = "left";
        c.save();
        c.translate(x, LINES.top - 8);
        c.rotate(-0.62);
        c.fillText(column.title.length > 30 ? `${column.title.slice(0, 29)}…` : column.title, 0, 0);
        c.restore();
        const ends = column.levels ? column.ticks : [column.ticks[0], column.ticks[4]];
        c.textAlign = k === columns.length - 1 ? "left" : "right";
        ends.forEach(([part, text]) => c.fillText(text, x + (k === columns.length - 1 ? 5 : -5), LINES.top + (1 - part) * h + 4));
        const range = ranges.get(k);
        if (range) {
          c.fillStyle = "rgba(0, 114, 178, 0.3)";
          c.fillRect(x - 7, LINES.top + (1 - range[1]) * h, 14, (range[1] - range[0]) * h);
        }
      });
    }
    function tell() {
      let n = 0, met = 0;
      for (let k = 0; k < count; k += 1) { if (kept[k]) { n += 1; met += words[verdict[k]] === "met" ? 1 : 0; } }
      const brushed = [...ranges].map(([k, [low, high]]) => `${columns[k].name} from ${told(columns[k].at(low))} to ${told(columns[k].at(high))}`);
      said.textContent = `${n} of ${count} designs${brushed.length ? ` with ${brushed.join(", ")}` : ""}: ${met} meet all requirements (${n ? Math.round(100 * met / n) : 0} %). Blue: met, orange: violated, grey: no verdict. Drag along an axis below to keep a range; click a point to name it.`;
    }
    function draw() { keep(); drawScatter(); drawAxes(); tell(); }
    clear.addEventListener("click", () => { ranges.clear(); chosen = -1; one.textContent = ""; draw(); });
    scatter.node.addEventListener("click", (event) => {
      const box = scatter.node.getBoundingClientRect(), x = columns[xs.value], y = columns[ys.value];
      const w = box.width - BOX.left - BOX.right, h = box.height - BOX.top - BOX.bottom;
      const px = event.clientX - box.left - BOX.left, py = event.clientY - box.top - BOX.top;
      let best = Infinity;
      for (let n = 0; n < count; n += 1) {
        const away = Math.hypot(x.part(x.values[n]) * w - px, (1 - y.part(y.values[n])) * h - py);
        if (kept[n] && away < best) { best = away; chosen = n; }
      }
      if (chosen < 0) { return; }
      const rows = columns.map((column) => `${column.title}: ${column.levels ? column.levels[column.values[chosen]] : told(column.values[chosen])}`);
      one.textContent = `${rows.join("\n")}\n${data.command} --case ${data.cases[chosen]}`;
      drawScatter();
    });
    let dragged = null;
    const partAt = (event) => {
      const box = axes.node.getBoundingClientRect(), h = box.height - LINES.top - LINES.bottom;
      return Math.min(1, Math.max(0, 1 - (event.clientY - box.top - LINES.top) / h));
    };
    axes.node.addEventListener("pointerdown", (event) => {
      const box = axes.node.getBoundingClientRect(), x = event.clientX - box.left;
      let nearest = 0;
      columns.forEach((_, k) => { if (Math.abs(place(k, box.width) - x) < Math.abs(place(nearest, box.width) - x)) { nearest = k; } });
      if (Math.abs(place(nearest, box.width) - x) > 25) { return; }
      dragged = [nearest, partAt(event)];
      axes.node.setPointerCapture(event.pointerId);
    });
    axes.node.addEventListener("pointermove", (event) => {
      if (dragged) {
        const now = partAt(event);
        ranges.set(dragged[0], [Math.min(dragged[1], now), Math.max(dragged[1], now)]);
        drawAxes();
      }
    });
    axes.node.addEventListener("pointerup", () => {
      if (dragged) {
        const range = ranges.get(dragged[0]);
        if (!range || range[1] - range[0] < 0.02) { ranges.delete(dragged[0]); }
        dragged = null;
        draw();
      }
    });
    addEventListener("resize", draw);
    dark.addEventListener("change", draw);
    draw();
  }
  document.querySelectorAll(".designs").forEach((script) => explore(script.parentNode));
}());
