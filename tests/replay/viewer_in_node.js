// Runs a page's scripts with three.js itself, but without a browser: elements and the renderer are stand-ins.
// Arguments: the page, and for a live one a file of frames. Prints what is shown as JSON.
"use strict";
const fs = require("fs");
const vm = require("vm");
const html = fs.readFileSync(process.argv[2], "utf8");
const scripts = [...html.matchAll(/<script[^>]*>([\s\S]*?)<\/script>/g)].map((match) => match[1]);

class Item {
  constructor() {
    Object.assign(this, { children: [], style: {}, dataset: {}, handlers: {}, textContent: "", className: "", checked: true, value: "1" });
    const names = new Set();
    this.classList = {
      add: (name) => names.add(name), contains: (name) => names.has(name),
      toggle: (name, on) => (on ? names.add(name) : names.delete(name)) };
  }
  get firstChild() { return this.children[0]; }
  append(...items) { this.children.push(...items); }
  replaceChildren(...items) { this.children = items; }
  addEventListener(name, handler) { this.handlers[name] = handler; }
}
class EventSource {
  constructor(url) { Object.assign(this, { url, handlers: {}, open: true }); sources.push(this); }
  addEventListener(name, handler) { this.handlers[name] = handler; }
  close() { this.open = false; }
}
const items = Object.fromEntries([...html.matchAll(/\bid="(\w+)"/g)].map((match) => [match[1], new Item()]));
items.data.textContent = scripts[0];
const body = new Item();
const sources = [];
let [clock, waiting, stage] = [0, [], null];
const page = {
  document: {
    getElementById: (id) => items[id], createElement: () => new Item(), createElementNS: () => new Item(),
    querySelectorAll: () => [], body, activeElement: body },
  window: { devicePixelRatio: 1, innerWidth: 800, innerHeight: 600, addEventListener() {}, location: { hash: "#pause" } },
  atob: (text) => Buffer.from(text, "base64").toString("latin1"), performance: { now: () => clock },
  requestAnimationFrame: (draw) => waiting.push(draw), EventSource, URLSearchParams, console };
page.globalThis = page.self = page;
vm.createContext(page);
vm.runInContext(scripts[1] + ";globalThis.THREE = THREE;", page);
page.THREE = { ...page.THREE,
  WebGLRenderer: class {
    constructor() { this.shadowMap = {}; }
    setPixelRatio() {}
    setSize() {}
    render(scene) { stage = scene; }
  },
  OrbitControls: class { constructor() { this.target = new page.THREE.Vector3(); } update() {} addEventListener() {} } };
vm.runInContext(scripts[2], page);

function step(ms) {
  clock += ms;
  const due = waiting;
  waiting = [];
  for (const draw of due) draw(clock);
}
function solids() {
  const found = [];
  stage.traverse((item) => { if (item.isMesh && !item.isInstancedMesh && item.visible) found.push(item.position.toArray()); });
  return found;
}
function arrow() { // where the head of the first arrow of the first field is
  let heads = null;
  stage.traverse((item) => { if (item.isInstancedMesh) heads ??= item.parent.children[1]; });
  const matrix = new page.THREE.Matrix4();
  heads.getMatrixAt(0, matrix);
  return matrix.elements.slice(12, 15);
}
function trails() {
  const found = [];
  stage.traverse((item) => { if (item.isLine && !item.isLineSegments) found.push(item.geometry.drawRange.count); });
  return found.filter(Number.isFinite);
}
function seen() {
  const texts = items.facts.children.map((child) => child.textContent);
  return {
    badge: items.outcome.textContent, beside: items.distance.textContent, story: !items.story.hidden,
    facts: Object.fromEntries(texts.filter((_, i) => i % 2 === 0).map((name, i) => [name, texts[2 * i + 1]])),
    marked: items.facts.children.flatMap((child, i) => (child.className === "bad" ? [texts[i - 1]] : [])),
    events: items.events.children.map((row) => row.firstChild.textContent),
    past: items.events.children.filter((row) => row.firstChild.classList.contains("past")).length,
    marks: items.marks.children.map((mark) => [mark.className, parseFloat(mark.style.left)]),
    clock: items.clock.textContent, solids: solids(), arrow: arrow(), trails: trails() };
}
step(16);
const told = [seen()];
if (sources.length) {
  for (const frame of JSON.parse(fs.readFileSync(process.argv[3], "utf8"))) {
    sources[0].handlers.message({ data: JSON.stringify(frame) });
    step(50);
  }
  told.push(seen());
  step(800);
  told.push(seen());
  sources[0].handlers.over();
  step(16);
  told.push({ ...seen(), open: sources[0].open });
} else {
  items.events.children[2].firstChild.handlers.click();
  step(16);
  told.push(seen());
}
console.log(JSON.stringify(told));
