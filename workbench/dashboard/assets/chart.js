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

function size(box) {
  return document.fullscreenElement === box
    ? {width: window.innerWidth, height: window.innerHeight}
    : {width: box.clientWidth, height: box.wanted.figure.layout.height ?? HEIGHT};
}

async function draw(box) {
  const {figure, config} = box.wanted;
  const Plotly = await library;
  if (!box.isConnected || box.wanted.figure !== figure) return; // a newer one waits its turn
  const layout = {...keepZoom(figure.layout), ...size(box), autosize: false};
  const buttons = [...(config.modeBarButtonsToAdd ?? []), FULL_SCREEN];
  await Plotly.react(box, figure.data, layout, {...config, modeBarButtonsToAdd: buttons});
  box.removeAttribute("data-drawing");
}

function fit(box) {
  if (!box.layout || box.hasAttribute("data-drawing")) return; // not drawn yet: it will be in the right size
  const {width, height} = size(box);
  if (width > 0 && (width !== box.layout.width || height !== box.layout.height)) {
    window.Plotly.relayout(box, {width, height});
  }
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
  box.style.height = `${box.wanted.figure.layout.height ?? HEIGHT}px`;
  box.setAttribute("data-drawing", "");
  inTurn(() => draw(box));
  return () => {
    box.watching.disconnect();
    if (box.layout) window.Plotly.purge(box);
  };
}
