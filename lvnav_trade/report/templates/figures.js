// Figures of the page: data (lvnav_trade/plots/browser.py) drawn by uPlot when they scroll into view, or are printed.
(function () {
  const DARK = { "#0072B2": "#4da6e0", "#D55E00": "#f0883e", "#009E73": "#34c79b", "#CC79A7": "#e3a0c4",
    "#8C6D31": "#c4a35f", "#c4c9d1": "#4b5563", "#d1d5db": "#4b5563", "#6b7280": "#9aa3b2" };
  const MAPS = {
    YlGnBu: ["#ffffd9", "#edf8b1", "#c7e9b4", "#7fcdbb", "#41b6c4", "#1d91c0", "#225ea8", "#253494", "#081d58"],
    YlOrBr: ["#ffffe5", "#fff7bc", "#fee391", "#fec44f", "#fe9929", "#ec7014", "#cc4c02", "#993404", "#662506"],
  };
  const FONT = '11px "DejaVu Sans", "Segoe UI", Arial, sans-serif', SMALL = FONT.replace("11", "10");
  const PRINTED = 660;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const drawn = new Map();
  let printing = false;

  const ink = () => (dark.matches && !printing ? "#e5e7eb" : "#1f2937");
  const paper = () => (dark.matches && !printing ? "#111827" : "#ffffff");
  const soft = () => (dark.matches && !printing ? "#9aa3b2" : "#6b7280");
  const faint = () => (dark.matches && !printing ? "#374151" : "#e5e7eb");
  function colour(name) {
    if (!name || name === "black" || name === "#000000") { return ink(); }
    if (name === "white") { return paper(); }
    return dark.matches && !printing ? DARK[name] || name : name;
  }
  function node(parent, tag, style, text) {
    const found = parent.appendChild(document.createElement(tag));
    if (style) { found.className = style; }
    if (text) { found.textContent = text; }
    return found;
  }
  function short(value) {
    const size = Math.abs(value);
    if (value === 0) { return "0"; }
    return size >= 1e5 || size < 1e-3 ? value.toExponential(2).replace(/\.?0+e/, "e") : String(Number(value.toPrecision(4)));
  }
  function unpack(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k += 1) { bytes[k] = raw.charCodeAt(k); }
    return new Float32Array(bytes.buffer);
  }

  // What is drawn, with its arrays in place.
  function read(holder) {
    const figure = JSON.parse(holder.querySelector("script").textContent), arrays = figure.arrays.map(unpack);
    figure.panels.forEach((panel) => panel.marks.forEach((mark) => {
      ["x", "y", "low", "high", "x0", "x1", "y0", "y1", "values"].forEach((name) => {
        if (typeof mark[name] === "number") { mark[name] = arrays[mark[name]]; }
      });
      if (mark.kind === "line" && mark.x.length > 1) {
        mark.rising = mark.x.every((x, k) => k === 0 || x >= mark.x[k - 1]);
      }
    }));
    return figure;
  }

  // Limits of an axis that a panel's marks ask for: side "x" or "y".
  function extent(panel, side) {
    const logarithmic = panel[side + "scale"] === "log";
    let low = Infinity, high = -Infinity;
    function take(value) {
      if (Number.isFinite(value) && (!logarithmic || value > 0)) { low = Math.min(low, value); high = Math.max(high, value); }
    }
    panel.marks.forEach((mark) => {
      const names = { x: ["x", "x0", "x1"], y: ["y", "low", "high", "y0", "y1"] }[side];
      if (mark.kind === "limit" && mark.axis === side) { take(mark.at); }
      if (mark.kind !== "text") { names.forEach((name) => { if (mark[name]) { mark[name].forEach(take); } }); }
    });
    return [low, high];
  }
  function padded(panel, side, found) {
    const margin = side === "x" || panel.margin > 0.02 ? panel.margin ?? 0.02 : 0.05;
    const stated = panel[side + "lim"] || [null, null], logarithmic = panel[side + "scale"] === "log";
    let [low, high] = found;
    if (!(low <= high)) { [low, high] = logarithmic ? [0.1, 1] : [0, 1]; }
    if (logarithmic) {
      const room = Math.pow(high / low, margin) * (high > low ? 1 : 1.5);
      [low, high] = [low / room, high * room];
    } else {
      const room = margin * (high - Math.min(low, stated[0] ?? low)) || Math.abs(high) * 0.1 || 1;
      [low, high] = [low - room, high + room];
    }
    return [stated[0] ?? low, stated[1] ?? high];
  }
  function shares(option, one, other, columns) {
    const row = (k) => Math.floor(k / columns), column = (k) => k % columns;
    return one === other || option === true || (option === "row" && row(one) === row(other)) ||
      (option === "col" && column(one) === column(other));
  }
  function limits(figure, index, side) {
    let low = Infinity, high = -Infinity;
    figure.panels.forEach((panel, other) => {
      if (panel.marks.length && shares(figure["share" + side], index, other, figure.columns)) {
        const found = extent(panel, side);
        low = Math.min(low, found[0]);
        high = Math.max(high, found[1]);
      }
    });
    return padded(figure.panels[index], side, [low, high]);
  }

  // Draw the marks of a panel; u: uPlot, which holds the scales.
  function draw(u, panel) {
    const c = u.ctx, px = u.pxRatio, box = u.bbox;
    const left = box.left, right = box.left + box.width, top = box.top, bottom = box.top + box.height;
    const fx = (v) => (v === Infinity ? right : v === -Infinity ? left : u.valToPos(v, "x", true));
    const fy = (v) => (v === Infinity ? top : v === -Infinity ? bottom : u.valToPos(v, "y", true));
    function clipped(paint) {
      c.save();
      c.beginPath();
      c.rect(left, top, box.width, box.height);
      c.clip();
      paint();
      c.restore();
    }
    function stroke(mark) {
      c.strokeStyle = colour(mark.color);
      c.globalAlpha = mark.alpha ?? 1;
      c.lineWidth = Math.max(0.8, mark.lw ?? 1.4) * px;
      c.setLineDash((mark.ls || []).map((length) => length * px));
      c.lineJoin = "round";
    }
    function fill(mark, plain) {
      c.globalAlpha = mark.alpha ?? 1;
      c.fillStyle = colour(mark.color || "#9ca3af");
      if (mark.hatch && !plain) {
        const tile = document.createElement("canvas"), t = tile.getContext("2d"), size = Math.round(7 * px);
        tile.width = tile.height = size;
        t.fillStyle = c.fillStyle;
        t.fillRect(0, 0, size, size);
        t.strokeStyle = paper();
        t.lineWidth = px;
        t.beginPath();
        t.moveTo(0, size);
        t.lineTo(size, 0);
        t.stroke();
        c.fillStyle = c.createPattern(tile, "repeat");
      }
    }
    const paints = {
      line(mark) {
        stroke(mark);
        if (mark.ls) {
          c.beginPath();
          let open = false, before = 0;
          mark.x.forEach((x, k) => {
            const at = fx(x), up = fy(mark.y[k]);
            if (!Number.isFinite(at) || !Number.isFinite(up)) { open = false; return; }
            if (open && mark.step) { c.lineTo(at, before); }
            if (open) { c.lineTo(at, up); } else { c.moveTo(at, up); }
            open = true;
            before = up;
          });
          c.stroke();
        }
        if (mark.marker) { points(mark); }
      },
      band(mark) {
        fill(mark);
        let start = 0;
        const good = (k) => Number.isFinite(fy(mark.low[k])) && Number.isFinite(fy(mark.high[k]));
        const count = mark.x.length;
        while (start < count) {
          let end = start;
          while (end < count && good(end)) { end += 1; }
          if (end > start) {
            c.beginPath();
            for (let k = start; k < end; k += 1) {
              if (mark.step && k > start) { c.lineTo(fx(mark.x[k]), fy(mark.high[k - 1])); }
              c.lineTo(fx(mark.x[k]), fy(mark.high[k]));
            }
            for (let k = end - 1; k >= start; k -= 1) {
              if (mark.step && k < end - 1) { c.lineTo(fx(mark.x[k + 1]), fy(mark.low[k])); }
              c.lineTo(fx(mark.x[k]), fy(mark.low[k]));
            }
            c.closePath();
            c.fill();
          }
          start = end + 1;
        }
      },
      boxes(mark) {
        fill(mark);
        mark.x0.forEach((x0, k) => {
          const a = fx(x0), b = fx(mark.x1[k]), low = fy(mark.y0[k]), high = fy(mark.y1[k]);
          c.fillRect(a, Number.isFinite(low) ? low : bottom, b - a, high - (Number.isFinite(low) ? low : bottom));
        });
      },
      limit(mark) {
        stroke(mark);
        const at = mark.axis === "x" ? fx(mark.at) : fy(mark.at);
        c.beginPath();
        if (mark.axis === "x") { c.moveTo(at, top); c.lineTo(at, bottom); } else { c.moveTo(left, at); c.lineTo(right, at); }
        c.stroke();
      },
      cells(mark) {
        const map = MAPS[mark.cmap], span = Math.log(mark.scale[1] / mark.scale[0]);
        c.globalAlpha = 1;
        mark.values.forEach((value, k) => {
          if (!Number.isFinite(value)) { return; }
          const row = Math.floor(k / mark.shape[1]), column = k % mark.shape[1];
          const part = Math.min(1, Math.max(0, Math.log(value / mark.scale[0]) / span));
          c.fillStyle = map[Math.round(part * (map.length - 1))];
          const a = fx(mark.x[column]), b = fx(mark.x[column + 1]), low = fy(mark.y[row]), high = fy(mark.y[row + 1]);
          c.fillRect(a, Math.min(low, high), b - a + 0.5, Math.abs(high - low));
        });
      },
      text(mark) {
        c.globalAlpha = 1;
        c.fillStyle = colour(mark.color);
        c.font = SMALL.replace("10", 10 * px);
        c.textAlign = { center: "center", right: "right" }[mark.ha] || "left";
        c.textBaseline = { bottom: "bottom", top: "top" }[mark.va] || "middle";
        mark.texts.forEach((text, k) => {
          const at = mark.x_part ? left + mark.x[k] * box.width : fx(mark.x[k]);
          c.fillText(text, at, mark.y_part ? bottom - mark.y[k] * box.height : fy(mark.y[k]));
        });
      },
    };
    function points(mark) {
      const size = Math.max(1.1, (mark.ms ?? 4) * 0.62) * px * (mark.marker === "." ? 0.6 : 1);
      c.setLineDash([]);
      c.lineWidth = px * (mark.marker === "|" || mark.marker === "_" ? 2 : 1.1);
      c.fillStyle = mark.mfc === "none" ? "rgba(0,0,0,0)" : colour(mark.mfc || mark.color);
      mark.x.forEach((x, k) => {
        const at = fx(x), up = fy(mark.y[k]);
        if (Number.isFinite(at) && Number.isFinite(up)) { shape(c, mark.marker, at, up, size); }
      });
    }
    clipped(() => {
      const events = panel.events || { points: [], faults: [] }, areas = ["band", "boxes", "cells"];
      panel.marks.forEach((mark) => { if (areas.includes(mark.kind)) { paints[mark.kind](mark); } });
      c.fillStyle = panel.filled ? "#000000" : "#9ca3af";
      c.globalAlpha = panel.filled ? 0.18 : 0.25;
      events.faults.forEach(([, start, end]) => c.fillRect(fx(start), top, Math.max(2 * px, fx(end) - fx(start)), box.height));
      stroke({ color: "#6b7280", lw: 0.8, alpha: 0.7 });
      events.points.forEach(([, t]) => { c.beginPath(); c.moveTo(fx(t), top); c.lineTo(fx(t), bottom); c.stroke(); });
      panel.marks.forEach((mark) => { if (mark.kind !== "text" && !areas.includes(mark.kind)) { paints[mark.kind](mark); } });
    });
    panel.marks.forEach((mark) => { if (mark.kind === "text") { paints.text(mark); } });
    if (panel.named && panel.events) {
      c.globalAlpha = 1;
      c.fillStyle = soft();
      c.font = SMALL.replace("10", 10 * px);
      c.textAlign = "center";
      c.textBaseline = "bottom";
      groups(panel.events.points, fx, left, right, 22 * px).forEach(([at, text]) => c.fillText(text, at, top - 2 * px));
    }
    c.globalAlpha = 1;
    c.setLineDash([]);
  }
  function groups(events, fx, left, right, room) {
    const found = [];
    events.forEach(([, t], k) => {
      const at = fx(t), last = found[found.length - 1];
      if (at < left - 1 || at > right + 1) { return; }
      if (last && at - last[0] < room) { last[2] = k + 1; } else { found.push([at, k + 1, k + 1]); }
    });
    return found.map(([at, first, last]) => [at, first === last ? String(first) : first + "-" + last]);
  }
  function shape(c, marker, x, y, r) {
    c.beginPath();
    if (marker === "s") { c.rect(x - r, y - r, 2 * r, 2 * r); }
    else if (marker === "x" || marker === "X" || marker === "P" || marker === "*") {
      c.moveTo(x - r, y - r); c.lineTo(x + r, y + r); c.moveTo(x - r, y + r); c.lineTo(x + r, y - r);
    } else if (marker === "|") { c.moveTo(x, y - 1.4 * r); c.lineTo(x, y + 1.4 * r); }
    else if (marker === "_") { c.moveTo(x - 1.4 * r, y); c.lineTo(x + 1.4 * r, y); }
    else if ("^Dv<>ph".includes(marker)) {
      const turns = { "^": [3, 0], v: [3, 0.5], "<": [3, 0.75], ">": [3, 0.25], D: [4, 0], p: [5, 0], h: [6, 0] }[marker];
      for (let k = 0; k < turns[0]; k += 1) {
        const angle = 2 * Math.PI * (k / turns[0] + turns[1]);
        c.lineTo(x + 1.2 * r * Math.sin(angle), y - 1.2 * r * Math.cos(angle));
      }
      c.closePath();
    } else { c.arc(x, y, r, 0, 2 * Math.PI); }
    c.fill();
    c.stroke();
  }

  // Ticks of a logarithmic axis, as of plots/raster.py.
  const CLOSE = [[1, 2, 5], [1, 1.5, 2, 3, 5, 7], [1, 1.1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9]];
  function decades(u, axis, low, high) {
    const whole = multiples([1], low, high);
    if (whole.length >= 4) { return whole; }
    if (high >= 10 * low) {
      const close = multiples(CLOSE[0], low, high);
      return roomFor(u, axis, close) ? close : whole;
    }
    const found = CLOSE.map((parts) => multiples(parts, low, high)).find((ticks) => ticks.length >= 4);
    return found || even(low, high);
  }
  function roomFor(u, axis, ticks) {
    const px = u.pxRatio || 1, width = u.bbox.width / px || u.width, height = u.bbox.height / px || u.height;
    return axis > 0
      ? 12 * ticks.length <= height
      : ticks.reduce((sum, at) => sum + 6.3 * short(at).length + 8, 0) <= width;
  }
  function multiples(parts, low, high) {
    const found = [];
    for (let e = Math.floor(Math.log10(low)); e <= Math.ceil(Math.log10(high)); e += 1) {
      parts.forEach((m) => {
        const at = Number((m * Math.pow(10, e)).toPrecision(6));
        if (at >= low && at <= high) { found.push(at); }
      });
    }
    return found;
  }
  function even(low, high) {
    const power = Math.pow(10, Math.floor(Math.log10((high - low) / 6)));
    const step = [1, 2, 2.5, 5, 10].map((m) => m * power).find((one) => (high - low) / one <= 6), found = [];
    for (let k = Math.ceil(low / step); k * step <= high; k += 1) { found.push(Number((k * step).toPrecision(6))); }
    return found;
  }
  function axis(panel, side, place, width) {
    const ticks = panel[side + "ticks"], logarithmic = panel[side + "scale"] === "log";
    const longest = ticks ? Math.max(0, ...ticks.map((tick) => tick[1].length)) : 7;
    const found = {
      scale: side, font: FONT, stroke: soft, ticks: { stroke: faint, size: 4, width: 1 },
      grid: { show: panel.grid !== false, stroke: faint, width: 1 },
      values: (u, splits) => splits.map((v) => (v === null ? "" : short(v))),
    };
    if (logarithmic) { found.splits = decades; found.filter = (u, splits) => splits; }
    if (side === "y") { found.size = 54; } else { found.size = 26; found.space = 58; }
    if (ticks) {
      const most = side === "y" ? Math.max(14, Math.floor((0.4 * width) / 6.3)) : 200;
      const name = (text) => { const one = text.replace(/\n/g, " "); return one.length > most ? one.slice(0, Math.ceil(most / 2) - 1) + "…" + one.slice(-Math.floor(most / 2)) : one; };
      const hidden = side === "y" && panel.labelled === false;
      found.splits = () => ticks.map((tick) => tick[0]);
      found.filter = (u, splits) => splits;
      found.values = (u, splits) => splits.map((at) => name((ticks.find((tick) => tick[0] === at) || ["", ""])[1]));
      if (hidden) { found.size = 12; found.values = (u, splits) => splits.map(() => ""); }
      else if (side === "y") { found.size = Math.max(14, 16 + 6.3 * Math.min(most, longest)); }
      else if (ticks.reduce((sum, tick) => sum + 7 * tick[1].length + 8, 0) > width - 60) {
        found.rotate = -32;
        found.size = Math.min(110, 26 + 3.6 * longest);
      }
    }
    return found;
  }

  // What stands under the cursor, in words.
  function readout(figure, panel, u) {
    const x = u.posToVal(u.cursor.left, "x"), found = [], span = u.scales.x.max - u.scales.x.min;
    panel.marks.forEach((mark) => {
      if (mark.kind !== "line" || !mark.rising || !mark.label) { return; }
      let low = 0, high = mark.x.length - 1;
      while (high - low > 1) { const middle = (low + high) >> 1; if (mark.x[middle] > x) { high = middle; } else { low = middle; } }
      const k = !mark.step && Math.abs(mark.x[high] - x) < Math.abs(mark.x[low] - x) ? high : low;
      if (Number.isFinite(mark.y[k]) && Math.abs(mark.x[k] - x) < 0.05 * span) { found.push(mark.label + ": " + short(panel.yscale === "root" ? Math.sqrt(mark.y[k]) : mark.y[k])); }
    });
    const near = (panel.events ? panel.events.points : []).filter((event) => Math.abs(event[1] - x) < 0.01 * span);
    const names = near.map((event) => event[0].replace(/_/g, " ")).join(", ");
    const y = u.posToVal(u.cursor.top, "y");
    return short(x) + (found.length ? " | " + found.join(" | ") : " , " + short(y)) + (names ? " | " + names : "");
  }

  function swatch(parent, mark) {
    const tile = node(parent, "canvas"), px = 2, c = tile.getContext("2d");
    tile.width = 26 * px;
    tile.height = 12 * px;
    if (mark.kind === "band" || mark.kind === "boxes") {
      c.fillStyle = colour(mark.color || "#9ca3af");
      c.globalAlpha = mark.alpha ?? 1;
      c.fillRect(2 * px, 2 * px, 22 * px, 8 * px);
      if (mark.hatch) {
        c.strokeStyle = paper();
        c.globalAlpha = 1;
        for (let k = 0; k < 6; k += 1) { c.beginPath(); c.moveTo((2 + 5 * k) * px, 10 * px); c.lineTo((9 + 5 * k) * px, 2 * px); c.stroke(); }
      }
      return;
    }
    c.strokeStyle = colour(mark.color);
    c.globalAlpha = Math.max(0.6, mark.alpha ?? 1);
    c.lineWidth = Math.min(4, Math.max(1.2, mark.lw ?? 1.4)) * px;
    if (mark.ls) {
      c.setLineDash(mark.ls.map((length) => length * px));
      c.beginPath();
      c.moveTo(1, 6 * px);
      c.lineTo(25 * px, 6 * px);
      c.stroke();
      c.setLineDash([]);
    }
    if (mark.marker) {
      c.lineWidth = px;
      c.fillStyle = mark.mfc === "none" ? "rgba(0,0,0,0)" : colour(mark.mfc || mark.color);
      shape(c, mark.marker, 13 * px, 6 * px, 3 * px);
    }
  }

  function make(holder) {
    remove(holder);
    const figure = read(holder), whole = printing ? PRINTED : holder.clientWidth, made = [];
    const body = node(holder, "div", "drawn");
    if (figure.title) { node(body, "div", "title", figure.title); }
    const narrow = whole < 560, columns = narrow ? 1 : figure.columns;
    const ratios = columns > 1 ? figure.widths || Array(columns).fill(1) : [1];
    const grid = node(body, "div", "panels");
    const inner = whole - 10 * (columns - 1), sum = ratios.reduce((a, b) => a + b, 0);
    const least = columns > 1 ? ratios.map((ratio) => Math.max(ratio / sum * inner, 0)) : [inner];
    if (columns > 1 && figure.sharey && figure.panels[0].yticks) {
      const label = axis(figure.panels[0], "y", 0, whole).size;
      ratios.forEach((ratio, k) => { least[k] = Math.max(40, ratio / sum * (inner - label)) + (k ? 0 : label); });
      least[columns - 1] -= least.reduce((a, b) => a + b, 0) - inner;
    }
    grid.style.gridTemplateColumns = least.map((width) => width + "px").join(" ");
    let out = null;
    figure.panels.forEach((panel, index) => {
      const column = columns > 1 ? index % figure.columns : 0, above = index - figure.columns;
      const cell = node(grid, "div", "panel");
      if (!panel.marks.length) { return; }
      panel.labelled = !(columns > 1 && index % figure.columns && figure.sharey && panel.yticks);
      panel.named = !(above >= 0 && figure.panels[above].events) || narrow;
      if (panel.title) { node(cell, "div", "title", panel.title); }
      // a panel beside one with a label has an empty line, so that both stand at the same height
      const beside = columns > 1 && figure.panels.some((other) => other.ylabel);
      if (panel.ylabel || beside) { node(cell, "div", "axis", panel.ylabel ? panel.ylabel.replace(/\n/g, " ") : "\u00a0"); }
      const width = Math.floor(least[column]), stated = panel.equal && panel.xlim;
      const height = Math.max(stated ? Math.min(width, 0.92 * width + 30) : 96 * figure.height * (printing ? 0.62 : narrow ? 0.8 : 0.92) - 34, 96);
      const x = limits(figure, index, "x"), y = limits(figure, index, "y");
      const left = panel.yticks ? axis(panel, "y", index, whole).size : 54;
      if (panel.equal && !stated) {
        const scale = Math.max((x[1] - x[0]) / (width - left - 8), (y[1] - y[0]) / (height - 46));
        [[x, width - left - 8], [y, height - 46]].forEach(([range, room]) => {
          const middle = (range[0] + range[1]) / 2;
          range[0] = middle - 0.5 * scale * room;
          range[1] = middle + 0.5 * scale * room;
        });
      }
      const turned = y[0] > y[1], text = panel.marks.some((mark) => mark.kind === "text" && mark.x_part && mark.x[0] > 1);
      const scale = (side, [low, high]) => ({
        time: false, auto: false, min: Math.min(low, high), max: Math.max(low, high), range: (u, a, b) => [a, b],
        ...(panel[side + "scale"] === "log" ? { distr: 3 } : {}),
        ...(panel[side + "scale"] === "root" ? { distr: 100, fwd: (v) => Math.sqrt(Math.max(v, 0)), bwd: (v) => v * v } : {}),
      });
      const u = new uPlot({
        width, height, pxAlign: 1, ...(printing ? { pxRatio: 2 } : {}),
        padding: [panel.named && panel.events ? 14 : 6, text ? 48 : 10, 0, panel.yticks && !panel.yticks.length ? 4 : 0],
        legend: { show: false },
        cursor: { drag: { x: true, y: true, uni: 12, setScale: false }, points: { show: false } },
        scales: { x: scale("x", x), y: { ...scale("y", y), ...(turned ? { dir: -1 } : {}) } },
        axes: [axis(panel, "x", index, width), axis(panel, "y", index, panel.labelled ? whole : width)],
        series: [{}, { show: true, paths: () => null, points: { show: false } }],
        hooks: {
          draw: [(self) => draw(self, panel)],
          setCursor: [(self) => { if (out && self.cursor.left >= 0) { out.textContent = readout(figure, panel, self); } }],
          setSelect: [(self) => {
            const s = self.select;
            if (!(s.width > 3 && s.height > 3)) { return; }
            const range = { min: self.posToVal(s.left, "x"), max: self.posToVal(s.left + s.width, "x") };
            const sides = [self.posToVal(s.top, "y"), self.posToVal(s.top + s.height, "y")];
            made.forEach((one) => { if (one === self || shares(figure.sharex, index, one.place, figure.columns)) { one.setScale("x", range); } });
            self.setScale("y", { min: Math.min(...sides), max: Math.max(...sides) });
            self.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          }],
        },
      }, [x.slice().sort((a, b) => a - b), [null, null]], cell);
      u.place = index;
      u.over.addEventListener("dblclick", () => made.forEach((one) => one.reset()));
      u.reset = () => { u.setScale("x", { min: Math.min(...x), max: Math.max(...x) }); u.setScale("y", { min: Math.min(...y), max: Math.max(...y) }); };
      made.push(u);
      if (panel.xlabel) { node(cell, "div", "axis below", panel.xlabel.replace(/\n/g, " ")); }
      panel.marks.filter((mark) => mark.kind === "cells" && mark.label).forEach((mark) => {
        const key = node(cell, "div", "scale");
        node(key, "span", "", mark.label.replace(/\n/g, " ") + ": " + short(mark.scale[0]));
        node(key, "i").style.background = "linear-gradient(90deg," + MAPS[mark.cmap].join(",") + ")";
        node(key, "span", "", short(mark.scale[1]));
      });
    });
    if (figure.legend.length) {
      const legend = node(body, "div", "legend");
      figure.legend.forEach((mark) => { const item = node(legend, "span"); swatch(item, mark); node(item, "span", "", mark.label); });
    }
    if (figure.key) { node(body, "div", "key", figure.key.replace(/\n/g, "   ")); }
    if (!printing) { out = node(body, "output", "readout", " "); }
    holder.style.minHeight = "";
    drawn.set(holder, made);
  }
  function remove(holder) {
    (drawn.get(holder) || []).forEach((u) => u.destroy());
    drawn.delete(holder);
    holder.querySelectorAll(".drawn").forEach((old) => old.remove());
  }

  const holders = Array.from(document.querySelectorAll(".figure"));
  const seen = new IntersectionObserver((entries) => entries.forEach((entry) => {
    if (entry.isIntersecting && !drawn.has(entry.target)) { make(entry.target); }
  }), { rootMargin: "300px" });
  holders.forEach((holder) => seen.observe(holder));
  const again = () => Array.from(drawn.keys()).forEach(make);
  dark.addEventListener("change", again);
  let width = innerWidth, waiting = 0;
  addEventListener("resize", () => {
    if (printing || innerWidth === width) { return; }
    width = innerWidth;
    clearTimeout(waiting);
    waiting = setTimeout(again, 150);
  });
  let opened = [];
  addEventListener("beforeprint", () => {
    if (printing) { return; }
    printing = true;
    opened = Array.from(document.querySelectorAll("details:not([open])"));
    opened.forEach((one) => { one.open = true; });
    holders.forEach(make);
  });
  addEventListener("afterprint", () => {
    printing = false;
    opened.forEach((one) => { one.open = false; });
    holders.forEach((holder) => { if (holder.getClientRects().length) { make(holder); } else { remove(holder); } });
  });
}());
