// Draws a Plotly figure in place of the one that it has drawn before: what the reader has zoomed into stays.
// data: {"figure": {data, layout}, "config": {…}, "alt": "…"} as JSON in UTF-8.

const LIBRARY = new URL("./@PLOTLY@", document.baseURI); // a route of the dashboard's server
const HEIGHT = 450; // px, of a figure that names none
const FULL_SCREEN = {
  name: "Full screen",
  title: "Full screen",
  icon: {width: 24, height: 24, path: "M4 4h6v2H6v4H4zM14 4h6v6h-2V6h-4zM4 14h2v4h4v2H4zM18 14h2v6h-6v-2h4z"},
  click: box => (document.fullscreenElement ? document.exitFullscreen() : box.requestFullscreen()),
};

const library = import(LIBRARY.href).then(() => window.Plotly);

// One figure at a time, in the page's order; the browser shows each before it begins with the next.
let last = Promise.resolve();
function inTurn(draw) {
  last = last.then(() => new Promise(done => requestAnimationFrame(done))).then(draw).catch(console.error);
  return last;
}

// A zoom holds as long as the axis means the same: a range of Hz is none of rad/s.
function keepZoom(layout) {
  layout.uirevision = "kept";
  for (const [name, axis] of Object.entries(layout)) {
    if (/^[xy]axis\d*$/.test(name)) axis.uirevision = [axis.type ?? "", axis.title?.text ?? ""].join();
  }
  return layout;
}

const NARROW = 620; // px: below it columns of panels stand one under the other, and the legend below the figure

// A title in as many lines as a width has room for.
function wrapped(text, width, letter) {
  const lines = [""], most = Math.floor(width / letter);
  for (const word of (text ?? "").split(" ")) {
    const last = lines[lines.length - 1];
    if (last && last.length + word.length >= most) lines.push(word);
    else lines[lines.length - 1] = last ? `${last} ${word}` : word;
  }
  return lines.join("<br>");
}

// Without the room that a title would have: the legend moves up, the panels keep their size.
const TITLE = 36; // px
function untitled(layout) {
  const top = layout.margin?.t ?? 0, height = layout.height ?? HEIGHT;
  if (layout.title?.text || top < 100) return layout;
  const y = 1 - ((1 - (layout.legend?.y ?? 1)) * height - TITLE) / (height - TITLE);
  return {...layout, height: height - TITLE, margin: {...layout.margin, t: top - TITLE}, legend: {...layout.legend, y}};
}

// The layout for a width: a narrow one has the panels in one column, and room for the legend's lines at the bottom.
function fitting(figure, width) {
  const {data} = figure, layout = untitled(figure.layout);
  if (width > NARROW) return layout;
  const narrow = structuredClone(layout), {rows = 1, columns = 1} = layout.meta ?? {};
  const height = (layout.height ?? HEIGHT) * (columns > 1 ? 0.95 * columns : 1);
  if (columns > 1) {
    // Of the paper, for a column: its head above it, ticks and title of the time below.
    const share = 1 / columns, part = share - 82 / height, head = 24 / height;
    const axis = (kind, row, column) => narrow[`${kind}axis${row + column ? row * columns + column + 1 : ""}`];
    for (let column = 0; column < columns; column++) {
      const bottom = 1 - column * share - head - part;
      for (let row = 0; row < rows; row++) {
        const y = axis("y", row, column), x = axis("x", row, column), first = axis("y", row, 0);
        y.domain = y.domain.map(v => bottom + v * part);
        y.title = {...first.title, font: {...first.title?.font, size: 11}};
        y.showticklabels = true;
        if (x) x.domain = [0, 1];
      }
    }
    const heads = (narrow.annotations ?? []).filter(note => note.xref === "paper" && note.yref === "paper" && note.y === 1);
    heads.forEach((note, column) => Object.assign(note, {x: 0.5, y: 1 - column * share - head}));
  }
  for (const note of narrow.annotations ?? []) {
    if (note.showarrow || !note.text) continue;
    Object.assign(note, {text: wrapped(note.text, width - 50, 6.2), font: {...note.font, size: 11}});
  }
  const title = wrapped(layout.title?.text, width - 30, 9), more = 20 * (title.split("<br>").length - 1);
  if (more) {
    narrow.title = {...narrow.title, text: title, font: {...narrow.title.font, size: 15}};
    narrow.margin = {...narrow.margin, t: (narrow.margin?.t ?? 80) + more};
  }
  const names = [...new Set(data.filter(t => t.name && t.showlegend !== false).map(t => t.legendgroup || t.name))];
  if (layout.showlegend === false || names.length < 2) return {...narrow, height: height + more};
  const across = Math.max(1, Math.floor(width / (60 + 7.5 * Math.max(...names.map(name => name.length)))));
  const lines = 22 * Math.ceil(names.length / across) + 12;
  narrow.legend = {...narrow.legend, x: 0, xref: "container", xanchor: "left", y: 0, yref: "container", yanchor: "bottom"};
  const top = layout.title?.text ? narrow.margin?.t : 30; // no legend stands there
  narrow.margin = {...narrow.margin, t: top, l: Math.min(narrow.margin?.l ?? 80, 64), r: 12, b: (narrow.margin?.b ?? 52) + lines};
  return {...narrow, height: height + lines + more};
}

function size(box) {
  return document.fullscreenElement === box
    ? {width: window.innerWidth, height: window.innerHeight}
    : {width: box.clientWidth, height: fitting(box.wanted.figure, box.clientWidth).height ?? HEIGHT};
}

async function draw(box) {
  const {figure, config} = box.wanted;
  const Plotly = await library;
  if (!box.isConnected || box.wanted.figure !== figure) return; // a newer one waits its turn
  box.narrow = box.clientWidth <= NARROW;
  const layout = {...keepZoom(fitting(figure, box.clientWidth)), ...size(box), autosize: false};
  box.style.height = `${layout.height}px`;
  const buttons = [...(config.modeBarButtonsToAdd ?? []), FULL_SCREEN];
  const quantities = layout.meta?.quantities;
  const data = quantities ? figure.data.map(trace => ({...trace, hoverinfo: "none", hovertemplate: null})) : figure.data;
  if (quantities) layout.hovermode = "x"; // the values stand in a table of their own
  await Plotly.react(box, data, layout, {...config, modeBarButtonsToAdd: buttons});
  await keepInside(box, Plotly);
  if (quantities && !box.reads) readOut(box);
  if (box.mark) await drawMark(box);
  box.removeAttribute("data-drawing");
}

// Words that would leave the figure at a side, or whose arrow leads them onto an axis' numbers, are moved back into it.
async function keepInside(box, Plotly) {
  const edge = box.getBoundingClientRect(), moves = {};
  const inner = Math.min(...[...box.querySelectorAll(".nsewdrag")].map(plot => plot.getBoundingClientRect().left));
  for (const drawn of box.querySelectorAll(".annotation[data-index]")) {
    const number = drawn.dataset.index, note = box.layout.annotations[number];
    const words = (drawn.querySelector(".annotation-text-g") ?? drawn).getBoundingClientRect();
    const left = note.showarrow === false ? edge.left : inner;
    const by = Math.max(0, words.right + 3 - edge.right) - Math.max(0, left + 3 - words.left);
    const key = note.showarrow === false ? "xshift" : "ax";
    if (by) moves[`annotations[${number}].${key}`] = (note[key] ?? 0) - by;
  }
  if (Object.keys(moves).length) await Plotly.relayout(box, moves);
}

function fit(box) {
  if (!box.layout || box.hasAttribute("data-drawing")) return; // not drawn yet: it will be in the right size
  const {width, height} = size(box);
  if (width <= 0 || (width === box.layout.width && height === box.layout.height)) return;
  if (box.narrow || width <= NARROW) inTurn(() => draw(box));
  else window.Plotly.relayout(box, {width, height});
}

// One cursor over all rows: a table of its values below the figure; a click sets a second cursor, another takes it away.
function readOut(box) {
  const frame = document.createElement("div"), table = document.createElement("table");
  Object.assign(frame.style, {position: "sticky", bottom: 0, height: 0, zIndex: 5});
  Object.assign(table.style, {position: "absolute", bottom: 0, right: 0, background: "var(--st-secondary-background-color)",
    fontSize: "0.8rem", fontVariantNumeric: "tabular-nums", borderRadius: "6px", padding: "4px", pointerEvents: "none"});
  frame.append(table);
  box.after(frame);
  box.reads = true;
  const number = value => (value === undefined ? "" : Number(value.toPrecision(4)).toString().replace("-", "\u2212"));
  const cell = (kind, text) => Object.assign(document.createElement(kind), {textContent: text});
  const read = points => {
    const {columns, quantities} = box.wanted.figure.layout.meta, values = {};
    for (const point of points) {
      const row = Math.floor((Number(point.yaxis._id.slice(1) || 1) - 1) / columns);
      (values[point.data.name] ??= {})[row] = point.y;
    }
    return {x: points[0].x, axis: points[0].xaxis._id, values, quantities};
  };
  const show = now => {
    const mark = box.mark, rows = [document.createElement("tr")];
    const time = mark ? `${number(now.x)} s (${number(now.x - mark.x)} s)` : `${number(now.x)} s`;
    rows[0].append(...[time, ...now.quantities].map(text => cell("th", text)));
    for (const [name, values] of Object.entries(now.values)) {
      const row = document.createElement("tr");
      row.append(cell("th", name), ...now.quantities.map((_, k) => {
        const by = mark?.values[name]?.[k] === undefined ? "" : ` (${number(values[k] - mark.values[name][k])})`;
        return cell("td", values[k] === undefined ? "" : number(values[k]) + by);
      }));
      rows.push(row);
    }
    table.replaceChildren(...rows);
    for (const each of table.querySelectorAll("th, td")) Object.assign(each.style, {padding: "1px 8px", textAlign: "right"});
    table.hidden = false;
  };
  table.hidden = true;
  box.on("plotly_hover", event => { box.now = read(event.points); show(box.now); });
  box.on("plotly_unhover", () => { table.hidden = !box.mark; });
  box.on("plotly_click", () => {
    box.mark = box.mark ? null : box.now;
    if (box.now) show(box.now);
    drawMark(box);
  });
}

// The cursor that stays: a dotted line over all rows.
function drawMark(box) {
  const own = box.wanted.figure.layout.shapes ?? [], {x, axis} = box.mark ?? {};
  const line = {width: 1, dash: "dot", color: box.layout.font?.color ?? "#808080"};
  const mark = {type: "line", x0: x, x1: x, xref: axis, y0: 0, y1: 1, yref: "paper", line};
  return window.Plotly.relayout(box, {shapes: box.mark ? [...own, mark] : own});
}

function boxIn(parent) {
  const box = document.createElement("div");
  box.className = "workbench-chart";
  box.setAttribute("role", "figure");
  box.style.width = "100%";
  box.style.background = "var(--st-background-color)";
  box.watching = new ResizeObserver(() => fit(box));
  parent.append(box);
  box.watching.observe(box);
  return box;
}

export default function ({data, parentElement}) {
  const box = parentElement.querySelector(":scope > .workbench-chart") ?? boxIn(parentElement);
  box.wanted = JSON.parse(new TextDecoder().decode(data));
  if (box.wanted.alt) box.setAttribute("aria-label", box.wanted.alt);
  box.style.height = `${size(box).height}px`;
  box.setAttribute("data-drawing", "");
  inTurn(() => draw(box));
  return () => {
    box.watching.disconnect();
    if (box.layout) window.Plotly.purge(box);
  };
}
