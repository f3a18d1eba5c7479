// Figures of the page: data (lvnav_trade/report/figures/browser.py) drawn by uPlot when they scroll into view, or are printed.
(function () {
  const DARK = { "#0072B2": "#4da6e0", "#D55E00": "#f0883e", "#009E73": "#34c79b", "#CC79A7": "#e3a0c4",
    "#8C6D31": "#c4a35f", "#c4c9d1": "#4b5563", "#d1d5db": "#4b5563", "#6b7280": "#9aa3b2" };
  const MAPS = {
    YlGnBu: ["#ffffd9", "#edf8b1", "#c7e9b4", "#7fcdbb", "#41b6c4", "#1d91c0", "#225ea8", "#253494", "#081d58"],
    YlOrBr: ["#ffffe5", "#fff7bc", "#fee391", "#fec44f", "#fe9929", "#ec7014", "#cc4c02", "#993404", "#662506"],
  };
  const FAMILY = 'px "DejaVu Sans", "Segoe UI", Arial, sans-serif';
  const PRINTED = { wide: 844, half: 414, third: 272 };  // pixels of a figure across the sheet, or beside others
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const drawn = new Map(), concealed = new Map();  // by holder: its plots, and the names that a click has hidden
  let printing = false, zoomed = null;  // the range of time that all figures show

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
      const span = high - Math.min(low, stated[0] ?? low), room = span > 0 ? margin * span : Math.abs(high) * 0.1 || 1;
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
    // A number that is missing has no place; a logarithmic axis would give it one. What is not positive lies below it.
    const place = (v, side, low, high, far) => {
      if (Number.isNaN(v)) { return NaN; }
      if (panel[side + "scale"] === "log" && v <= 0) { return far; }
      return v === Infinity ? high : v === -Infinity ? low : u.valToPos(v, side, true);
    };
    const fx = (v) => place(v, "x", left, right, left - box.width);
    const fy = (v) => place(v, "y", bottom, top, bottom + box.height);
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
          const good = (k) => Number.isFinite(mark.x[k]) && Number.isFinite(mark.y[k]);
          mark.x.forEach((x, k) => {
            if (!good(k)) { open = false; return; }
            const at = fx(x), up = fy(mark.y[k]);
            if (open && mark.step) { c.lineTo(at, before); }
            if (open) { c.lineTo(at, up); } else { c.moveTo(at, up); }
            if (!open && !good(k + 1)) { c.lineTo(at + px, up); }  // a value alone is a dot
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
        const good = (k) => Number.isFinite(mark.x[k]) && !Number.isNaN(mark.low[k]) && !Number.isNaN(mark.high[k]);
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
          if ([a, b, low, high].every(Number.isFinite)) { c.fillRect(a, low, b - a, high - low); }
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
        c.font = (printing ? 8 : 10) * px + FAMILY;
        c.textAlign = { center: "center", right: "right" }[mark.ha] || "left";
        c.textBaseline = { bottom: "bottom", top: "top" }[mark.va] || "middle";
        mark.texts.forEach((text, k) => {
          const at = mark.x_part ? left + mark.x[k] * box.width : fx(mark.x[k]);
          const up = mark.y_part ? bottom - mark.y[k] * box.height : fy(mark.y[k]);
          if (mark.x_part || mark.y_part || c.textAlign === "center") {
            const width = c.measureText(text).width;
            c.fillText(text, at, up);
            if (c.textAlign === "center") { taken.push([at - width / 2, up + { top: 6, middle: 0, bottom: -6 }[c.textBaseline] * px, width]); }
          } else { beside(text, at, up); }
        });
      },
    };
    // A text beside a point: on the side that has room for it, cut where neither has, and clear of those before it.
    const taken = [];
    function beside(text, at, up) {
      const line = 11 * px, middle = { top: 6, middle: 0, bottom: -6 }[c.textBaseline] * px, leftward = c.textAlign === "right", word = text.trim(), gap = text.length - word.length;
      const room = { left: right - at, right: at - left }, wide = c.measureText(text).width;
      const side = wide <= room[c.textAlign] || room[c.textAlign] >= room[leftward ? "left" : "right"] ? c.textAlign : leftward ? "left" : "right";
      const most = Math.floor((room[side] / wide) * text.length) - gap, shown = wide <= room[side] ? word : cut(word, Math.max(6, most));
      const padded = side === "left" ? " ".repeat(gap) + shown : shown + " ".repeat(gap), width = c.measureText(padded).width;
      const from = side === "left" ? at : at - width, clear = (y) => taken.every(([x, upper, size]) =>
        from + width < x || from > x + size || Math.abs(y + middle - upper) >= line);
      const y = [0, 1, -1, 2, -2, 3, -3].map((step) => up + step * line).find(clear) ?? up;
      const kept = c.textAlign;
      c.textAlign = side;
      c.fillText(padded, at, y);
      c.textAlign = kept;
      taken.push([from, y + middle, width]);
    }
    function points(mark) {
      const size = Math.max(1.1, (mark.ms ?? 4) * 0.62) * px * (mark.marker === "." ? 0.6 : 1);
      c.setLineDash([]);
      c.lineWidth = px * (mark.marker === "|" || mark.marker === "_" ? 2 : 1.1);
      c.fillStyle = mark.mfc === "none" ? "rgba(0,0,0,0)" : colour(mark.mfc || mark.color);
      mark.x.forEach((x, k) => {
        const at = fx(x), up = fy(mark.y[k]);
        if (Number.isFinite(at) && Number.isFinite(up) && k % (mark.every || 1) === 0) { shape(c, mark.marker, at, up, size); }
      });
    }
    clipped(() => {
      const events = panel.events || { points: [], faults: [] }, areas = ["band", "boxes", "cells"];
      const marks = panel.marks.filter((mark) => !panel.hidden.has(mark.group || mark.label));
      marks.forEach((mark) => { if (areas.includes(mark.kind)) { paints[mark.kind](mark); } });
      c.fillStyle = panel.filled ? "#000000" : "#9ca3af";
      c.globalAlpha = panel.filled ? 0.18 : 0.25;
      events.faults.forEach(([, start, end]) => c.fillRect(fx(start), top, Math.max(2 * px, fx(end) - fx(start)), box.height));
      stroke({ color: "#6b7280", lw: 0.8, alpha: 0.7 });
      events.points.forEach(([, t]) => { c.beginPath(); c.moveTo(fx(t), top); c.lineTo(fx(t), bottom); c.stroke(); });
      marks.forEach((mark) => { if (mark.kind !== "text" && !areas.includes(mark.kind)) { paints[mark.kind](mark); } });
    });
    panel.marks.forEach((mark) => { if (mark.kind === "text") { paints.text(mark); } });
    if (panel.above) {
      c.globalAlpha = 1;
      c.fillStyle = ink();
      c.font = (printing ? 8 : 10) * px + FAMILY;
      c.textAlign = "left";
      c.textBaseline = "bottom";
      const row = Math.abs(fy(1) - fy(0)), most = Math.floor(box.width / px / (printing ? 4.6 : 5.6));
      const names = cutApart(panel.yticks.map((tick) => tick[1]), most);
      panel.yticks.forEach(([at], k) => c.fillText(names[k], left + 2 * px, fy(at) - 0.3 * row - 2 * px));
    }
    if (panel.named && panel.events) {
      c.globalAlpha = 1;
      c.fillStyle = soft();
      c.font = (printing ? 8 : 10) * px + FAMILY;
      c.textBaseline = "bottom";
      if (panel.flags) {
        const at = panel.events.points.map(([name, t]) => [name, fx(t)]).filter((event) => event[1] >= left - 1 && event[1] <= right + 1);
        c.textAlign = "left";
        stroke({ color: "#6b7280", lw: 0.8, alpha: 0.7 });
        (flags(at, (text) => c.measureText(text).width, [left, right], px, panel.flags) || []).forEach(([text, x, from, row]) => {
          const up = top - (2 + row * FLAG) * px;
          c.beginPath();
          c.moveTo(x, top);
          c.lineTo(x, up - 9 * px);
          c.globalAlpha = 0.7;
          c.stroke();
          c.globalAlpha = 1;
          c.fillText(text, from, up);
        });
      } else {
        c.textAlign = "center";
        groups(panel.events.points, fx, left, right, 22 * px).forEach(([at, text]) => c.fillText(text, at, top - 2 * px));
      }
    }
    c.globalAlpha = 1;
    c.setLineDash([]);
  }
  // Places of the names of events above a panel, in at most so many rows: [text, line, start of the text, row], the last
  // event in the lowest row, so that no line crosses a name. Nothing where they do not fit.
  const FLAG = 11, ROWS = 4;  // pixels of a row; rows
  function flags(events, measure, [left, right], px, rows) {
    const found = [], begins = Array(rows).fill(Infinity), merged = [];
    events.forEach(([name, x]) => {
      const text = name.replace(/_/g, " "), last = merged[merged.length - 1];
      if (last && x - last[1] < 3 * px) { last[0] += ", " + text; } else { merged.push([text, x]); }
    });
    const fits = merged.reverse().every(([text, x]) => {
      const width = measure(text), from = Math.min(x + 3 * px, right - width);
      const row = begins.findIndex((begin, k) => from + width + 6 * px <= begin && begins.slice(0, k).every((lower) => lower > x));
      if (from < left) { return false; }
      if (row >= 0) { begins[row] = Math.min(from, x); found.push([text, x, from, row]); }
      return row >= 0;
    });
    return fits ? found : null;
  }
  // How many rows the names of events above the panels of a figure need; 0 where numbers stand for them.
  function flagRows(figure, widths, columns, whole) {
    const rows = figure.panels.map((panel, index) => {
      if (!panel.named || !panel.events || !panel.marks.length) { return 1; }
      const [low, high] = limits(figure, index, "x"), [left, right] = sides(figure, index, columns, whole);
      const width = Math.floor(widths[columns > 1 ? index % figure.columns : 0]) - left - right;
      const at = panel.events.points.filter(([, t]) => t >= low && t <= high).map(([name, t]) => [name, left + (t - low) / (high - low) * width]);
      const enough = [1, 2, 3, ROWS].find((count) => flags(at, (text) => measured(text, 10), [left, left + width], 1, count));
      return enough ?? Infinity;
    });
    const most = Math.max(...rows);
    return printing || !figure.key || most > ROWS ? 0 : most;
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

  // Ticks of a logarithmic axis, as of report/figures/raster.py.
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
  // Letters of a name left of a figure; names of bars that are longer stand above these.
  const lettersOf = (width) => Math.max(14, Math.floor((0.36 * width) / (printing ? 5 : 6.3)));
  function cut(text, most) {
    const line = text.replace(/\n/g, " ");
    return line.length > most ? line.slice(0, Math.ceil(most / 2) - 1) + "…" + line.slice(-Math.floor(most / 2)) : line;
  }
  // Names that are cut in the middle, or at their start where that would make two of them the same.
  function cutApart(names, most) {
    const ways = [(name) => cut(name, most), (name) => (name.length > most ? "…" + name.slice(1 - most) : name), (name) => name];
    return ways.map((way) => names.map(way)).find((found) => new Set(found).size === new Set(names).size);
  }
  const ruler = document.createElement("canvas").getContext("2d");
  function measured(text, size) {  // width in pixels
    ruler.font = size + FAMILY;
    return ruler.measureText(text).width;
  }
  function axis(panel, side, place, width) {
    const ticks = panel[side + "ticks"], logarithmic = panel[side + "scale"] === "log";
    const longest = ticks ? Math.max(0, ...ticks.map((tick) => tick[1].length)) : 7;
    const found = {
      scale: side, font: (printing ? 9 : 11) + FAMILY, stroke: soft, ticks: { stroke: faint, size: 4, width: 1 },
      grid: { show: panel.grid !== false, stroke: faint, width: 1 },
      values: (u, splits) => splits.map((v) => (v === null ? "" : short(v))),
    };
    if (logarithmic) { found.splits = decades; found.filter = (u, splits) => splits; }
    if (side === "y") { found.size = printing ? 42 : 54; } else { found.size = printing ? 20 : 26; found.space = printing ? 44 : 58; }
    if (ticks) {
      const most = side === "y" ? lettersOf(width) : 200;
      const hidden = side === "y" && (panel.labelled === false || panel.above);
      found.splits = () => ticks.map((tick) => tick[0]);
      found.filter = (u, splits) => splits;
      const names = cutApart(ticks.map((tick) => tick[1].replace(/\n/g, " ")), most);
      found.values = (u, splits) => splits.map((at) => names[ticks.findIndex((tick) => tick[0] === at)] || "");
      if (hidden) { found.size = 12; found.values = (u, splits) => splits.map(() => ""); }
      else if (side === "y") { found.size = Math.max(14, 18 + Math.max(0, ...names.map((name) => measured(name, printing ? 9 : 11)))); }
      else if (ticks.reduce((sum, tick) => sum + 7 * tick[1].length + 8, 0) > width - 60) {
        found.rotate = -32;
        found.size = Math.min(110, 26 + 3.6 * longest);
      }
    }
    return found;
  }

  // The values under the cursor, with units and the colours of their lines, in an output element.
  function readout(out, panel, u) {
    const x = u.posToVal(u.cursor.left, "x"), y = u.posToVal(u.cursor.top, "y"), span = u.scales.x.max - u.scales.x.min;
    const value = (number, unit) => short(number) + (unit ? " " + unit : ""), found = [];
    panel.marks.forEach((mark) => {
      if (mark.kind !== "line" || !mark.rising || !mark.label || panel.hidden.has(mark.group || mark.label)) { return; }
      let low = 0, high = mark.x.length - 1;
      while (high - low > 1) { const middle = (low + high) >> 1; if (mark.x[middle] > x) { high = middle; } else { low = middle; } }
      const k = !mark.step && Math.abs(mark.x[high] - x) < Math.abs(mark.x[low] - x) ? high : low;
      if (Number.isFinite(mark.y[k]) && Math.abs(mark.x[k] - x) < 0.05 * span) {
        found.push([mark, value(panel.yscale === "root" ? Math.sqrt(mark.y[k]) : mark.y[k], panel.yunit)]);
      }
    });
    out.textContent = (panel.xname ? panel.xname + " = " : "") + value(x, panel.xunit);
    found.forEach(([mark, text]) => {
      out.append(" · ");
      const item = node(out, "span", "", mark.label + ": " + text);
      if (mark.color && mark.color !== "white") { item.style.color = colour(mark.color); }
    });
    if (!found.length && !(panel.yticks && panel.yscale !== "root")) { out.append(", " + value(y, panel.yunit)); }
    const near = (panel.events ? panel.events.points : []).filter((event) => Math.abs(event[1] - x) < 0.01 * span);
    if (near.length) { out.append(" · " + near.map((event) => event[0].replace(/_/g, " ")).join(", ")); }
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
    if (mark.color === "white") {  // as it is drawn: on a line of ink
      c.strokeStyle = ink();
      c.lineWidth = 4 * px;
      c.beginPath();
      c.moveTo(1, 6 * px);
      c.lineTo(25 * px, 6 * px);
      c.stroke();
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

  // Columns of a figure in a width: how many, and how wide each is.
  function columnsOf(figure, whole, narrow) {
    const columns = narrow ? 1 : figure.columns, inner = whole - 10 * (columns - 1);
    const ratios = columns > 1 ? figure.widths || Array(columns).fill(1) : [1], sum = ratios.reduce((a, b) => a + b, 0);
    const widths = columns > 1 ? ratios.map((ratio) => Math.max(ratio / sum * inner, 0)) : [inner];
    if (columns > 1 && figure.sharey && figure.panels[0].yticks) {
      const label = axis(figure.panels[0], "y", 0, whole).size;
      ratios.forEach((ratio, k) => { widths[k] = Math.max(40, ratio / sum * (inner - label)) + (k ? 0 : label); });
      widths[columns - 1] -= widths.reduce((a, b) => a + b, 0) - inner;
    }
    return widths;
  }
  const hasNote = (panel) => panel.marks.some((mark) => mark.kind === "text" && mark.x_part && mark.x[0] > 1);
  // The room left and right of a panel: panels below each other with one abscissa are aligned.
  function sides(figure, index, columns, whole) {
    const aligned = figure.panels.filter((other, k) => other.marks.length && (k === index ||
      (figure.sharex && (columns === 1 ? figure.columns === 1 : k % columns === index % columns))));
    const most = (value) => Math.max(...aligned.map(value));
    return [most((other) => axis(other, "y", index, whole).size), most((other) => (hasNote(other) ? 48 : 10))];
  }
  // Limits of the ordinates of what a range of abscissas shows; those stated are kept.
  function shownLimits(panel, range, whole) {
    const values = [], stated = panel.ylim || [null, null];
    panel.marks.forEach((mark) => {
      if (!mark.x || mark.kind === "text" || mark.kind === "cells" || panel.hidden.has(mark.group || mark.label)) { return; }
      mark.x.forEach((x, k) => {
        if (x >= range.min && x <= range.max) { [mark.y, mark.low, mark.high].forEach((side) => { if (side) { values.push(side[k]); } }); }
      });
    });
    const logarithmic = panel.yscale === "log";
    const good = values.filter((value) => Number.isFinite(value) && (!logarithmic || value > 0));
    if (!good.length || panel.yticks && panel.yscale !== "root" || (stated[0] !== null && stated[1] !== null && panel.yscale !== "root")) { return whole; }
    const kept = { ...panel, ylim: [stated[0], null] };
    return padded(kept, "y", [good.reduce((a, b) => Math.min(a, b)), good.reduce((a, b) => Math.max(a, b))]);
  }

  function make(holder) {
    remove(holder);
    const kind = holder.closest("figure").className, halved = kind === "half" || kind === "third";
    const figure = read(holder), whole = printing ? PRINTED[kind] : holder.clientWidth, made = [];
    const body = node(holder, "div", "drawn"), hidden = concealed.get(holder) || new Set();
    concealed.set(holder, hidden);
    if (figure.title) { node(body, "div", "title", figure.title); }
    const narrow = whole < 560 && !printing, columns = narrow ? 1 : figure.columns;
    const grid = node(body, "div", "panels");
    figure.panels.forEach((panel, index) => {
      panel.hidden = hidden;
      panel.labelled = !(columns > 1 && index % figure.columns && figure.sharey && panel.yticks);
      const longest = Math.max(0, ...(panel.yticks || []).map((tick) => tick[1].length));
      panel.above = longest > lettersOf(whole) && panel.marks.some((mark) => mark.kind === "boxes") && panel.marks.every((mark) => mark.kind !== "cells");
    });
    const widths = columnsOf(figure, whole, narrow);
    figure.panels.forEach((panel, index) => {
      panel.named = !(index >= figure.columns && figure.panels[index - figure.columns].events) || narrow;
    });
    const rows = flagRows(figure, widths, columns, whole);
    figure.panels.forEach((panel) => { panel.flags = rows; });
    grid.style.gridTemplateColumns = widths.map((width) => width + "px").join(" ");
    let out = null;
    const redraw = () => made.forEach((u) => u.redraw(false));
    figure.panels.forEach((panel, index) => {
      const column = columns > 1 ? index % figure.columns : 0;
      const cell = node(grid, "div", "panel");
      if (!panel.marks.length) { return; }
      if (panel.title) { node(cell, "div", "title", panel.title); }
      // a panel beside one with a label has an empty line, so that both stand at the same height
      const beside = columns > 1 && figure.panels.some((other) => other.ylabel);
      if (panel.ylabel || beside) { node(cell, "div", "axis", panel.ylabel ? panel.ylabel.replace(/\n/g, " ") : "\u00a0"); }
      const width = Math.floor(widths[column]), stated = panel.equal && panel.xlim;
      const map = panel.marks.some((mark) => mark.kind === "cells");
      const part = printing ? (map ? 0.36 : halved ? 0.41 : 0.53) : narrow ? 0.8 : 0.92;
      const flagged = panel.named && panel.events && rows ? FLAG * (rows - 1) : 0;
      const heights = panel.above ? (printing ? 26 : 38) * panel.yticks.length + 46 : 96 * figure.height * part - (printing ? 16 : 34);
      const height = Math.max(stated ? Math.min(width, 0.92 * width + 30) : heights, printing ? 72 : 96) + flagged;
      const x = limits(figure, index, "x"), y = limits(figure, index, "y");
      const [left, right] = sides(figure, index, columns, whole);
      if (panel.equal && !stated) {
        const scale = Math.max((x[1] - x[0]) / (width - left - 8), (y[1] - y[0]) / (height - 46));
        [[x, width - left - 8], [y, height - 46]].forEach(([range, room]) => {
          const middle = (range[0] + range[1]) / 2;
          range[0] = middle - 0.5 * scale * room;
          range[1] = middle + 0.5 * scale * room;
        });
      }
      const turned = y[0] > y[1];
      const scale = (side, [low, high]) => ({
        time: false, auto: false, min: Math.min(low, high), max: Math.max(low, high), range: (u, a, b) => [a, b],
        ...(panel[side + "scale"] === "log" ? { distr: 3 } : {}),
        ...(panel[side + "scale"] === "root" ? { distr: 100, fwd: (v) => Math.sqrt(Math.max(v, 0)), bwd: (v) => v * v } : {}),
      });
      const u = new uPlot({
        width, height, pxAlign: 1, ...(printing ? { pxRatio: 2 } : {}),
        padding: [panel.above || (panel.named && panel.events) ? 14 + flagged : 6, right, 0, panel.yticks && !panel.yticks.length ? 4 : 0],
        legend: { show: false },
        cursor: { drag: { x: true, y: true, uni: 12, setScale: false }, points: { show: false } },
        scales: { x: scale("x", x), y: { ...scale("y", y), ...(turned ? { dir: -1 } : {}) } },
        axes: [axis(panel, "x", index, width), { ...axis(panel, "y", index, panel.labelled ? whole : width), size: left }],
        series: [{}, { show: true, paths: () => null, points: { show: false } }],
        hooks: {
          draw: [(self) => draw(self, panel)],
          setCursor: [(self) => { if (out && self.cursor.left >= 0) { readout(out, panel, self); } }],
          setSelect: [(self) => { select(self, figure, made); }],
        },
      }, [x.slice().sort((a, b) => a - b), [null, null]], cell);
      u.place = index;
      u.linked = Boolean(panel.linked);
      u.over.addEventListener("dblclick", () => {
        if (u.linked) { zoomed = null; }
        (u.linked ? everyDrawn().filter((one) => one.linked || made.includes(one)) : made).forEach((one) => one.reset());
      });
      const range = (ends) => ({ min: Math.min(...ends), max: Math.max(...ends) });
      u.zoom = (ends) => { u.setScale("x", ends); u.setScale("y", range(shownLimits(panel, ends, y))); };
      u.reset = () => { u.setScale("x", range(x)); u.setScale("y", range(y)); };
      made.push(u);
      if (u.linked && zoomed && !printing) { u.zoom(zoomed); }
      const shown = cell.querySelector("canvas");
      shown.setAttribute("role", "img");
      shown.setAttribute("aria-label", panel.alt || "");
      if (panel.xlabel) { node(cell, "div", "axis below", panel.xlabel.replace(/\n/g, " ")); }
    });
    figure.panels.forEach((panel) => panel.marks.filter((mark) => mark.kind === "cells" && mark.label).forEach((mark) => {
      const key = node(body, "div", "scale");
      node(key, "span", "", mark.label.replace(/\n/g, " ") + ", logarithmic:");
      node(key, "span", "", short(mark.scale[0]));
      node(key, "i").style.background = "linear-gradient(90deg," + MAPS[mark.cmap].join(",") + ")";
      node(key, "span", "", String(Number(mark.scale[1].toPrecision(3))));
    }));
    if (figure.legend.length) { legend(body, figure, hidden, redraw); }
    // on paper the events are named below the first figure of a section
    const first = !printing || holder === holder.closest("section, details[id]")?.querySelector(".figure");
    const key = (figure.key || "").replace(/\n/g, " · "), shaded = key.match(/shaded: .*/);
    if (key && first && (!rows || shaded)) { node(body, "div", "key", rows ? shaded[0] : key); }
    if (!printing) {
      out = node(body, "output", "readout", hint(figure));
      grid.addEventListener("mouseleave", () => { out.textContent = hint(figure); });
    }
    holder.style.minHeight = "";
    drawn.set(holder, made);
  }
  const hint = (figure) => (figure.panels.some((panel) => panel.linked)
    ? "drag to zoom (all figures over time follow), double-click to reset, click a legend entry to hide it"
    : "drag to zoom, double-click to reset");
  const everyDrawn = () => Array.from(drawn.values()).flat();
  function legend(body, figure, hidden, redraw) {
    const list = node(body, "div", "legend");
    figure.legend.forEach((mark) => {
      const item = node(list, "button"), name = mark.group || mark.label;
      const press = () => item.setAttribute("aria-pressed", String(!hidden.has(name)));
      item.type = "button";
      swatch(item, mark);
      node(item, "span", "", mark.label);
      press();
      item.addEventListener("click", () => {
        if (!hidden.delete(name)) { hidden.add(name); }
        press();
        redraw();
      });
    });
  }
  // Zoom to a selection: one across the panel is of abscissas alone, and ordinates follow what is shown.
  function select(u, figure, made) {
    const s = u.select, across = s.height >= u.over.clientHeight - 2;
    if (!(s.width > 3 || s.height > 3)) { return; }
    const range = { min: u.posToVal(s.left, "x"), max: u.posToVal(s.left + s.width, "x") };
    const ends = [u.posToVal(s.top, "y"), u.posToVal(s.top + s.height, "y")];
    if (u.linked) { zoomed = range; }
    const others = made.filter((one) => shares(figure.sharex, u.place, one.place, figure.columns));
    new Set([...others, ...(u.linked ? everyDrawn().filter((one) => one.linked) : [])]).forEach((one) => one.zoom(range));
    if (!across) { u.setScale("y", { min: Math.min(...ends), max: Math.max(...ends) }); }
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
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
  // On paper figures of a half or a third of the width stand beside each other: the next ones of that width are moved up.
  let opened = [], moved = [];
  function gather(kind, count) {
    const every = Array.from(document.querySelectorAll("figure." + kind));
    new Set(every.map((one) => one.parentNode)).forEach((parent) => {
      const alike = every.filter((one) => one.parentNode === parent);
      alike.forEach((one, k) => {
        const before = alike[k - 1];
        if (k % count === 0 || before.nextElementSibling === one) { return; }
        const place = document.createComment("");
        parent.replaceChild(place, one);
        before.after(one);
        moved.push([place, one]);
      });
    });
  }
  // A heading stays with what follows in a section; in an element of details it may be the last line of a sheet.
  let unfolded = [];
  function move(from, to) { to.append(...from.childNodes); from.replaceWith(to); }
  function unfold() {
    document.querySelectorAll("details[id]").forEach((one) => {
      const section = document.createElement("section");
      move(one, section);
      unfolded.push([section, one]);
    });
  }
  addEventListener("beforeprint", () => {
    if (printing) { return; }
    printing = true;
    opened = Array.from(document.querySelectorAll("details:not([open])"));
    opened.forEach((one) => { one.open = true; });
    unfold();
    gather("third", 3);
    gather("half", 2);
    holders.forEach(make);
  });
  addEventListener("afterprint", () => {
    printing = false;
    moved.reverse().forEach(([place, one]) => place.replaceWith(one));
    moved = [];
    unfolded.forEach(([section, one]) => move(section, one));
    unfolded = [];
    opened.forEach((one) => { one.open = false; });
    holders.forEach((holder) => { if (holder.getClientRects().length) { make(holder); } else { remove(holder); } });
  });
}());
