"use strict";
// One control per block of data on the page: a source of error, its sigma times a factor, and what becomes of the error.
(function () {
  function add(parent, tag, attributes, text) {
    var svg = ["svg", "path", "circle", "line", "text"].indexOf(tag) >= 0;
    var node = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
    Object.keys(attributes || {}).forEach(function (name) { node.setAttribute(name, attributes[name]); });
    if (text !== undefined) { node.textContent = text; }
    return parent.appendChild(node);
  }
  function options(select, names) {
    select.textContent = "";
    names.forEach(function (name, index) { add(select, "option", { value: index }, name); });
  }
  function frozen(metric, source, factor) {
    return Math.sqrt(metric.square + (factor * factor - 1) * source.square);
  }
  function told(value) { return Number(value.toPrecision(3)).toString(); }
  function draw(svg, metric, source, factor) {
    var width = 420, height = 190, left = 52, bottom = 34, top = 12;
    var most = frozen(metric, source, 10), points = source.retuned || [];
    points.forEach(function (point) { most = Math.max(most, point[1]); });
    function x(f) { return left + (Math.log10(f) + 1) / 2 * (width - left - 12); }
    function y(v) { return height - bottom - v / (1.05 * most) * (height - bottom - top); }
    svg.textContent = "";
    [0.1, 0.3, 1, 3, 10].forEach(function (f) {
      add(svg, "line", { x1: x(f), x2: x(f), y1: top, y2: height - bottom, stroke: "#e5e7eb" });
      add(svg, "text", { x: x(f), y: height - bottom + 13, "text-anchor": "middle" }, f);
    });
    [0, 0.5, 1].forEach(function (part) {
      var level = y(part * most);
      add(svg, "line", { x1: left, x2: width - 12, y1: level, y2: level, stroke: "#e5e7eb" });
      add(svg, "text", { x: left - 5, y: level + 4, "text-anchor": "end" }, told(part * most));
    });
    var way = "";
    for (var k = 0; k <= 60; k += 1) {
      var f = Math.pow(10, k / 30 - 1);
      way += (k ? "L" : "M") + x(f).toFixed(1) + " " + y(frozen(metric, source, f)).toFixed(1);
    }
    add(svg, "path", { d: way, fill: "none", stroke: "#0072B2", "stroke-width": 2 });
    points.forEach(function (point) {
      add(svg, "circle", { cx: x(point[0]), cy: y(point[1]), r: 4, fill: "#D55E00" });
    });
    add(svg, "circle", { cx: x(factor), cy: y(frozen(metric, source, factor)), r: 5, fill: "white", stroke: "#0072B2",
      "stroke-width": 2.5 });
    add(svg, "text", { x: (left + width) / 2, y: height - 4, "text-anchor": "middle" }, "sigma of the source, times");
  }
  Array.prototype.forEach.call(document.querySelectorAll("script.grades"), function (data) {
    var rows = JSON.parse(data.textContent), box = data.parentNode.insertBefore(document.createElement("div"), data);
    box.className = "grades";
    var line = add(box, "p");
    var which = add(line, "select", { "aria-label": "case and error" });
    var what = add(line, "select", { "aria-label": "source of error" });
    var label = add(box, "label", {}, "sigma of this source ");
    var slide = add(label, "input", { type: "range", min: -1, max: 1, step: 0.01, value: 0, "aria-label": "factor" });
    var factorText = add(label, "output"), result = add(box, "p", { "aria-live": "polite" });
    var picture = add(box, "svg", { viewBox: "0 0 420 190", role: "img", "aria-label": "error over factor" });
    add(box, "p", { "class": "key" },
      "Line: gains of the campaign's filter (exact). Points: a filter re-tuned to the new sigma, where computed.");
    function show() {
      var metric = rows[which.value], source = metric.sources[what.value];
      var factor = Math.pow(10, Number(slide.value)), value = frozen(metric, source, factor);
      factorText.textContent = " × " + told(factor);
      var change = 100 * (value / Math.sqrt(metric.square) - 1);
      result.textContent = metric.metric + ": " + told(value) + " " + metric.unit + " with gains frozen, now " +
        told(Math.sqrt(metric.square)) + " " + metric.unit + " (" + (change > 0 ? "+" : "") + change.toFixed(1) + " %)";
      draw(picture, metric, source, factor);
    }
    function choose() {
      options(what, rows[which.value].sources.map(function (source) {
        return source.name + " (" + (100 * source.square / rows[which.value].square).toFixed(1) + " %)";
      }));
      show();
    }
    options(which, rows.map(function (row) { return row.case + ": " + row.metric; }));
    which.addEventListener("change", choose);
    what.addEventListener("change", show);
    slide.addEventListener("input", show);
    choose();
  });
}());
