// Tables that sort by a click on a heading and filter by a word; links of the navigation open what they lead to.
(function () {
  const FILTERED = 12;
  function value(row, column) {
    const text = row.cells[column].textContent.trim().replace(/^[✓✗?!]\s*/, "").replace("∞", "Infinity");
    const number = parseFloat(text);
    return Number.isNaN(number) ? text : number;
  }
  document.querySelectorAll(".table > table").forEach((table) => {
    const body = table.tBodies[0], rows = Array.from(body.rows);
    if (rows.length < 3) { return; }
    Array.from(table.tHead.rows[0].cells).forEach((cell, column) => {
      let sign = -1;
      cell.title = "sort";
      cell.addEventListener("click", () => {
        sign = -sign;
        rows.sort((a, b) => {
          const one = value(a, column), other = value(b, column);
          if (typeof one === "number" && typeof other === "number") { return sign * (one - other); }
          return sign * String(one).localeCompare(String(other), "en", { numeric: true });
        });
        rows.forEach((row) => body.appendChild(row));
      });
    });
    if (rows.length > FILTERED) {
      const input = document.createElement("input");
      input.className = "filter";
      input.type = "search";
      input.placeholder = "filter " + rows.length + " rows";
      input.setAttribute("aria-label", "filter rows");
      table.parentNode.parentNode.insertBefore(input, table.parentNode);
      input.addEventListener("input", () => {
        const words = input.value.toLowerCase().split(/\s+/);
        rows.forEach((row) => { row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word)); });
      });
    }
  });
  function open() {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (target && target.tagName === "DETAILS") { target.open = true; target.scrollIntoView(); }
  }
  addEventListener("hashchange", open);
  document.querySelectorAll("nav a").forEach((link) => link.addEventListener("click", () => setTimeout(open)));
  open();
}());
