// Shows the rollouts that html.py packed into the page. Units are metres and seconds, z is up, quaternions are wxyz.
"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const page = JSON.parse($("data").textContent);
  const COLORS = { ground: 0xb4533c, side: 0x5f7590, overhead: 0x7a5aa6, other: 0x7c8da3 };
  const [SGF, OGF, TOUCHED] = [0x1f6fe5, 0xe8710a, 0xc80014];
  const ARROW_M = 0.3; // length that the arrow of a very strong field approaches
  const FIELD_SCALE = 0.6; // field strength drawn at 63 % of ARROW_M

  // ---- data ----------------------------------------------------------------------------------------------------
  function int16(text) {
    const raw = atob(text);
    const bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    const view = new DataView(bytes.buffer);
    return Int16Array.from({ length: bytes.length / 2 }, (_, i) => view.getInt16(2 * i, true));
  }
  function unpack(packed) {
    return Float32Array.from(int16(packed.data), (value) => value * packed.scale);
  }
  function decode(record) {
    if (record.ready) return record;
    for (const key of ["geom_pos", "geom_quat", "arrow_pos", "arrow_force", "root_pos", "object_pos"])
      record[key] = unpack(record[key]);
    for (const key of record.moving ? ["moving_pos", "moving_quat"] : []) record[key] = unpack(record[key]);
    record.ready = true;
    return record;
  }

  // ---- view ----------------------------------------------------------------------------------------------------
  // What lives has to be drawn in time: without a graphics card simply, unless pictures are made ("#fine").
  function drawnBySoftware() {
    const gl = document.createElement("canvas").getContext?.("webgl2");
    const about = gl?.getExtension("WEBGL_debug_renderer_info");
    return Boolean(about) && /swiftshader|llvmpipe|software/i.test(gl.getParameter(about.UNMASKED_RENDERER_WEBGL));
  }
  const simple = Boolean(page.live) && !window.location.hash.includes("fine") && drawnBySoftware();
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ canvas: $("view"), antialias: !simple });
  } catch (error) {
    $("failure").hidden = false;
    $("failure").textContent = "This page needs WebGL, which this browser does not offer (" + error.message + ").";
    return;
  }
  renderer.shadowMap.enabled = true;
  renderer.setPixelRatio(simple ? 0.5 : Math.min(window.devicePixelRatio, 2));
  const shaded = (look, roughness, metalness = 0) => (simple ? new THREE.MeshLambertMaterial(look)
    : new THREE.MeshStandardMaterial({ ...look, roughness, metalness }));
  const stage = new THREE.Scene();
  stage.background = new THREE.Color(0xeef2f6);
  stage.fog = new THREE.Fog(0xeef2f6, 9, 26);
  const camera = new THREE.PerspectiveCamera(40, 1, 0.02, 100);
  camera.up.set(0, 0, 1);
  const orbit = new THREE.OrbitControls(camera, renderer.domElement);
  orbit.enableDamping = true;
  orbit.maxPolarAngle = 0.495 * Math.PI;
  orbit.minDistance = 0.4;
  orbit.maxDistance = 20;

  stage.add(new THREE.HemisphereLight(0xffffff, 0xd0d7df, 2.3));
  const sun = new THREE.DirectionalLight(0xffffff, 2.2);
  sun.castShadow = !simple;
  sun.shadow.mapSize.set(2048, 2048);
  Object.assign(sun.shadow.camera, { left: -3.5, right: 3.5, top: 3.5, bottom: -3.5, near: 0.5, far: 14 });
  sun.shadow.bias = -0.0005;
  sun.shadow.normalBias = 0.01;
  stage.add(sun, sun.target);
  const floor = new THREE.Mesh(
    new THREE.PlaneGeometry(60, 60), shaded({ color: 0xc9d1da }, 1));
  floor.receiveShadow = true;
  floor.position.z = -0.004;
  stage.add(floor);

  // ---- building blocks -----------------------------------------------------------------------------------------
  // Sizes follow MuJoCo: half extents; radius, half length; local z is the axis.
  function geometry(type, size, mesh) {
    const [a, b, c] = size;
    switch (type) {
      case "box": return new THREE.BoxGeometry(2 * a, 2 * b, 2 * c);
      case "sphere": return new THREE.SphereGeometry(a, 28, 18);
      case "ellipsoid": return new THREE.SphereGeometry(1, 28, 18).scale(a, b, c);
      case "capsule": return new THREE.CapsuleGeometry(a, 2 * b, 10, 24).rotateX(Math.PI / 2);
      case "cylinder": return new THREE.CylinderGeometry(a, a, 2 * b, 36).rotateX(Math.PI / 2);
      case "mesh": {
        const shape = new THREE.BufferGeometry();
        shape.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(mesh.vertices), 3));
        shape.setIndex(mesh.faces);
        shape.computeVertexNormals();
        return shape;
      }
      default: throw new Error("unknown shape " + type);
    }
  }
  function place(item, position, wxyz) {
    item.position.set(...position);
    item.quaternion.set(wxyz[1], wxyz[2], wxyz[3], wxyz[0]);
    return item;
  }
  function ring(radius, color) {
    const item = new THREE.Mesh(
      new THREE.RingGeometry(Math.max(radius - 0.018, 0), radius, 64), new THREE.MeshBasicMaterial({ color }));
    item.position.z = 0.003;
    return item;
  }
  function path(points, color) {
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(points, 3));
    const line = new THREE.Line(shape, new THREE.LineBasicMaterial({ color }));
    line.frustumCulled = false;
    return line;
  }

  // A path that grows; of the oldest points one half goes when it is full.
  class Trail {
    constructor(color, most = 4000) {
      this.points = new Float32Array(3 * most);
      this.count = 0;
      this.line = path(this.points, color);
      this.line.geometry.setDrawRange(0, 0);
    }
    add(point) {
      if (3 * this.count === this.points.length) {
        this.count >>= 1;
        this.points.copyWithin(0, this.points.length - 3 * this.count);
      }
      this.points.set(point, 3 * this.count++);
      this.line.geometry.setDrawRange(0, this.count);
      this.line.geometry.attributes.position.needsUpdate = true;
    }
  }

  // Lines every 0.5 m, 2 m beyond the scene; one short segment per cell, as some drivers drop lines that pass the camera.
  function floorGrid(low, high) {
    const cell = 0.5;
    const [x0, y0, x1, y1] = [low[0] - 2, low[1] - 2, high[0] + 2, high[1] + 2].map((v) => Math.round(v / cell));
    const points = [];
    for (let x = x0; x <= x1; x++)
      for (let y = y0; y <= y1; y++) {
        if (x < x1) points.push(x, y, 0, x + 1, y, 0);
        if (y < y1) points.push(x, y, 0, x, y + 1, 0);
      }
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(points, (v) => v * cell), 3));
    return new THREE.LineSegments(shape, new THREE.LineBasicMaterial({ color: 0xb4bfcb }));
  }

  class Arrows {
    constructor(record, rows, color) {
      this.record = record;
      this.rows = rows;
      const material = new THREE.MeshBasicMaterial({ color, depthTest: false, transparent: true, opacity: 0.92 });
      this.shafts = new THREE.InstancedMesh(
        new THREE.CylinderGeometry(0.0055, 0.0055, 1, 8).translate(0, 0.5, 0), material, rows.length);
      this.heads = new THREE.InstancedMesh(
        new THREE.ConeGeometry(0.017, 0.045, 12).translate(0, -0.0225, 0), material, rows.length);
      this.group = new THREE.Group();
      for (const mesh of [this.shafts, this.heads]) {
        mesh.frustumCulled = false;
        mesh.renderOrder = 5;
        this.group.add(mesh);
      }
    }
    update(i, j, weight) {
      const { record } = this;
      const width = record.arrow_is_ogf.length * 3;
      const up = new THREE.Vector3(0, 1, 0);
      const [at, force, turn, matrix] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Quaternion(), new THREE.Matrix4()];
      const read = (array, row, out) => out.set(
        ...[0, 1, 2].map((k) => mix(array[i * width + 3 * row + k], array[j * width + 3 * row + k], weight)));
      this.rows.forEach((row, n) => {
        read(record.arrow_pos, row, at);
        const strength = read(record.arrow_force, row, force).length();
        const length = ARROW_M * (1 - Math.exp(-strength / FIELD_SCALE));
        turn.setFromUnitVectors(up, strength > 1e-9 ? force.divideScalar(strength) : up);
        const head = length > 0.004 ? Math.min(1, length / 0.07) : 0;
        const shaft = Math.max(length - 0.04 * head, 0);
        this.shafts.setMatrixAt(n, matrix.compose(at, turn, new THREE.Vector3(head, shaft, head)));
        at.addScaledVector(force, strength > 1e-9 ? length : 0);
        this.heads.setMatrixAt(n, matrix.compose(at, turn, new THREE.Vector3(head, head, head)));
      });
      this.shafts.instanceMatrix.needsUpdate = this.heads.instanceMatrix.needsUpdate = true;
    }
  }
  const mix = (a, b, weight) => a + (b - a) * weight;

  // ---- one rollout ---------------------------------------------------------------------------------------------
  class Show {
    constructor(record) {
      this.record = decode(record);
      this.root = new THREE.Group();
      this.addScene(record.scene);
      this.geoms = record.geoms.map((geom) => this.addGeom(geom));
      this.trails = page.live ? [new Trail(0x334155), new Trail(0xc2410c)] : [];
      this.paths = page.live ? this.trails.map((trail) => trail.line)
        : [path(record.root_pos, 0x334155), path(record.object_pos, 0xc2410c)];
      const rows = record.arrow_is_ogf.map((_, row) => row);
      this.sgf = new Arrows(record, rows.filter((row) => !record.arrow_is_ogf[row]), SGF);
      this.ogf = new Arrows(record, rows.filter((row) => record.arrow_is_ogf[row]), OGF);
      this.root.add(...this.paths, this.sgf.group, this.ogf.group);
    }
    addGeom(geom) {
      const [r, g, b, alpha] = geom.rgba;
      const look = { color: new THREE.Color().setRGB(r, g, b, "srgb"), transparent: alpha < 1, opacity: alpha };
      const material = geom.object ? shaded(look, 0.8) : shaded(look, 0.45, 0.15);
      const mesh = new THREE.Mesh(geometry(geom.type, geom.size), material);
      mesh.castShadow = mesh.receiveShadow = true;
      mesh.name = geom.name ?? "";
      if (geom.object && geom.type === "box")
        mesh.add(new THREE.LineSegments(new THREE.EdgesGeometry(mesh.geometry), new THREE.LineBasicMaterial({ color: 0x6b4a1c })));
      this.root.add(mesh);
      return mesh;
    }
    addScene(scene) {
      this.obstacles = scene.obstacles.map((obstacle) => {
        const color = COLORS[obstacle.category] ?? COLORS.other;
        const material = shaded({ color, transparent: true, side: THREE.DoubleSide }, 0.9);
        const mesh = place(new THREE.Mesh(geometry(obstacle.type, obstacle.size, obstacle.mesh), material),
          obstacle.position, obstacle.quaternion);
        mesh.castShadow = mesh.receiveShadow = true;
        const edges = new THREE.LineSegments(
          new THREE.EdgesGeometry(mesh.geometry, 30), new THREE.LineBasicMaterial({ color, transparent: true, opacity: 0.8 }));
        mesh.add(edges);
        mesh.name = obstacle.name;
        this.root.add(mesh);
        return mesh;
      });
      const goal = new THREE.Group();
      const green = 0x16a34a;
      const pole = new THREE.Mesh(
        new THREE.CylinderGeometry(0.006, 0.006, 0.75, 10).rotateX(Math.PI / 2).translate(0, 0, 0.375),
        new THREE.MeshBasicMaterial({ color: green, transparent: true, opacity: 0.6 }));
      const ball = new THREE.Mesh(new THREE.SphereGeometry(0.03, 20, 14), new THREE.MeshBasicMaterial({ color: green }));
      ball.position.z = 0.75;
      goal.add(ring(page.goal_radius_m, green), pole, ball);
      goal.position.set(scene.goal[0], scene.goal[1], 0);
      const start = ring(0.07, 0x64748b);
      start.position.x = scene.start[0];
      start.position.y = scene.start[1];
      const [low, high] = scene.bounds;
      const corners = [[low, low], [high, low], [high, high], [low, high], [low, low]];
      const bounds = path(Float32Array.from(corners.flatMap(([x, y]) => [x[0], y[1], 0.004])), 0x7b8a9b);
      this.root.add(goal, start, bounds, floorGrid(low, high));
    }
    options() {
      this.sgf.group.visible = $("sgf").checked;
      this.ogf.group.visible = $("ogf").checked;
      for (const line of this.paths) line.visible = $("trail").checked;
      const solid = $("solid").checked;
      for (const mesh of this.obstacles) {
        mesh.material.opacity = solid ? 1 : 0.5;
        mesh.material.depthWrite = solid;
        mesh.material.needsUpdate = true;
      }
    }
    // Solids that have touched by time t glow, from then on: what ends a trial is seen where it happened.
    mark(t) {
      const touched = new Set(this.record.events.filter((event) => event.time <= t + 1e-6).flatMap((event) => event.solids ?? []));
      for (const mesh of [...this.geoms, ...this.obstacles]) mesh.material.emissive.setHex(touched.has(mesh.name) ? TOUCHED : 0);
    }
    // Poses at time t: positions and quaternions are interpolated between the two frames around it.
    update(t) {
      const { time, geom_pos, geom_quat, moving = [], moving_pos, moving_quat } = this.record;
      let i = 0;
      for (let high = time.length - 1; high - i > 1;) {
        const middle = (i + high) >> 1;
        if (time[middle] <= t) i = middle; else high = middle;
      }
      const j = Math.min(i + 1, time.length - 1);
      const weight = j > i ? Math.min(Math.max((t - time[i]) / (time[j] - time[i]), 0), 1) : 0;
      const pose = (meshes, p, q) => meshes.forEach((mesh, g) => {
        const [a, b] = [i * meshes.length + g, j * meshes.length + g];
        mesh.position.set(...[0, 1, 2].map((k) => mix(p[3 * a + k], p[3 * b + k], weight)));
        const [w, x, y, z] = [0, 1, 2, 3].map((k) => mix(q[4 * a + k], q[4 * b + k], weight));
        mesh.quaternion.set(x, y, z, w).normalize();
      });
      pose(this.geoms, geom_pos, geom_quat);
      pose(moving.map((o) => this.obstacles[o]), moving_pos, moving_quat);
      this.sgf.update(i, j, weight);
      this.ogf.update(i, j, weight);
      return [0, 1, 2].map((k) => mix(this.record.root_pos[3 * i + k], this.record.root_pos[3 * j + k], weight));
    }
    // Gives the carried object another shape.
    reshape(shape) {
      this.geoms.filter((_, i) => this.record.geoms[i].object).forEach((mesh) => {
        mesh.geometry.dispose();
        mesh.geometry = shape;
        for (const edges of [...mesh.children]) {
          edges.geometry.dispose();
          edges.geometry = new THREE.EdgesGeometry(shape, 30);
        }
      });
    }
    dispose() {
      stage.remove(this.root);
      this.root.traverse((item) => {
        item.geometry?.dispose();
        item.material?.dispose();
        if (item instanceof THREE.InstancedMesh) item.dispose();
      });
    }
  }

  // ---- state and controls --------------------------------------------------------------------------------------
  const state = { index: 0, time: 0, playing: true, hold: 0 };
  let stale_picture = true; // drawn anew only when something has changed
  const redraw = () => { stale_picture = true; };
  orbit.addEventListener("change", redraw);
  let show = null;
  let followed = null;

  function describe(record) {
    $("outcome").textContent = record.outcome.replaceAll("_", " ");
    $("outcome").className = "badge " + (["success", "timeout", "running"].includes(record.outcome) ? record.outcome : "failure");
    $("distance").textContent = record.distance_m.toFixed(2) + " m from the goal";
    listFacts([["Policy", record.policy], ["Object", record.carried], ["Obstacles", record.obstacle_text]]);
  }
  function listFacts(rows) {
    $("facts").replaceChildren(...rows.flatMap(([name, text, bad]) => {
      const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
      dt.textContent = name;
      dd.textContent = text;
      dd.className = bad ? "bad" : "";
      return [dt, dd];
    }));
  }

  // Marks above the slider, and a list whose rows lead to their time; what is over is bold.
  function tell(record) {
    const [first, last] = [record.time[0], record.time[record.time.length - 1]];
    const inside = (t) => Math.min(Math.max(t, first), last);
    $("story").hidden = record.events.length === 0;
    $("marks").replaceChildren(...record.events.map((event) => {
      const mark = document.createElement("i");
      mark.className = event.kind;
      mark.title = event.text;
      mark.style.left = `${last > first ? 100 * (inside(event.time) - first) / (last - first) : 0}%`;
      return mark;
    }));
    $("events").replaceChildren(...record.events.map((event) => {
      const [row, button] = [document.createElement("li"), document.createElement("button")];
      button.className = event.kind;
      button.textContent = `${event.time.toFixed(2)} s  ${event.text}`;
      button.addEventListener("click", () => { setPlaying(false); state.time = inside(event.time); });
      row.append(button);
      return row;
    }));
  }
  function select(index) {
    state.index = (index + page.records.length) % page.records.length;
    const record = page.records[state.index];
    show?.dispose();
    show = new Show(record);
    stage.add(show.root);
    show.options();
    plot(record);
    redraw();
    state.time = record.time[0];
    state.hold = 0;
    $("rollout").value = String(state.index);
    $("time").min = record.time[0];
    $("time").max = record.time[record.time.length - 1];
    describe(record);
    tell(record);
    followed = null;
    frame("angle");
  }
  function frame(view) {
    const record = page.records[state.index];
    const [low, high] = record.scene.bounds;
    const root = $("follow").checked ? show.update(state.time) : [0, 1].map((k) => 0.5 * (low[k] + high[k]));
    const target = new THREE.Vector3(root[0] + ($("follow").checked ? 0.35 : 0), root[1], 0.68);
    const reach = ($("follow").checked ? 3.6 : 1.6 * Math.max(high[0] - low[0], high[1] - low[1]))
      * Math.max(1, 1.15 / camera.aspect);
    const direction = { angle: [0.42, -0.83, 0.36], side: [0, -1, 0.06], front: [1, 0, 0.12], top: [-0.001, 0, 1] }[view];
    redraw();
    camera.position.copy(target).addScaledVector(new THREE.Vector3(...direction).normalize(), reach);
    orbit.target.copy(target);
    orbit.update();
  }
  function setPlaying(playing) {
    const record = page.records[state.index];
    if (playing && state.time >= record.time[record.time.length - 1]) state.time = record.time[0];
    state.playing = playing;
    state.hold = 0;
    $("play").textContent = playing ? "❚❚" : "▶";
    redraw();
  }
  function step(direction) {
    setPlaying(false);
    const times = page.records[state.index].time;
    const nearest = times.reduce((best, t, i) => (Math.abs(t - state.time) < Math.abs(times[best] - state.time) ? i : best), 0);
    state.time = times[Math.min(Math.max(nearest + direction, 0), times.length - 1)];
    redraw();
  }

  function jump(share) {
    const times = page.records[state.index].time;
    setPlaying(false);
    state.time = share ? times[times.length - 1] : times[0];
  }

  // ---- curves of the rollout --------------------------------------------------------------------------------------
  // Way to the goal, and clearance where the record has it; both over the slider's time, with the present as a line.
  const CURVES = [["distance", "#1d55b0", "root to goal"], ["clearance", "#974106", "clearance"]];
  function curves(record) {
    const [goal, root] = [record.scene.goal, record.root_pos];
    const distance = record.time.map((_, i) => Math.hypot(root[3 * i] - goal[0], root[3 * i + 1] - goal[1]));
    return { distance, clearance: record.clearance ?? [] };
  }
  function plot(record) {
    const canvas = $("plot");
    if (page.live || !canvas.getContext) return;
    const all = curves(record);
    const ratio = Math.min(window.devicePixelRatio, 2);
    const [width, height] = [canvas.clientWidth || 300, canvas.clientHeight || 70];
    [canvas.width, canvas.height] = [width * ratio, height * ratio];
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const [first, last] = [record.time[0], record.time[record.time.length - 1]];
    const most = Math.max(0.1, ...CURVES.flatMap(([name]) => all[name]));
    const x = (t) => 1 + (width - 2) * (last > first ? (t - first) / (last - first) : 0);
    const y = (v) => height - 2 - (height - 4) * Math.max(v, 0) / most;
    for (const [name, color] of CURVES) {
      pen.strokeStyle = color;
      pen.lineWidth = 1.6;
      pen.beginPath();
      all[name].forEach((v, i) => (i ? pen.lineTo(x(record.time[i]), y(v)) : pen.moveTo(x(record.time[i]), y(v))));
      pen.stroke();
    }
    $("legend").textContent = CURVES.filter(([name]) => all[name].length)
      .map(([name, , words]) => `${words} up to ${Math.max(...all[name]).toFixed(2)} m`).join(", ");
  }
  function showPresent(record, t) {
    const all = curves(record);
    let i = 0;
    while (i < record.time.length - 1 && record.time[i + 1] <= t) i++;
    const share = (t - record.time[0]) / Math.max(record.time[record.time.length - 1] - record.time[0], 1e-9);
    $("present").style.left = `${100 * share}%`;
    $("values").replaceChildren(...CURVES.filter(([name]) => all[name].length).map(([name, color, words]) => {
      const value = document.createElement("span");
      value.textContent = `${words} ${all[name][i].toFixed(3)} m`;
      value.style.color = color;
      return value;
    }));
  }

  page.records.forEach((record, i) => {
    const option = document.createElement("option");
    option.value = String(i);
    option.textContent = page.live ? record.scene.name
      : `${i + 1}. ${record.scene.name} (${record.outcome.replaceAll("_", " ")})`;
    $("rollout").append(option);
  });
  $("rollout").addEventListener("change", () => select(Number($("rollout").value)));
  $("previous").addEventListener("click", () => select(state.index - 1));
  $("next").addEventListener("click", () => select(state.index + 1));
  $("play").addEventListener("click", () => setPlaying(!state.playing));
  $("time").addEventListener("input", () => { setPlaying(false); state.time = Number($("time").value); redraw(); });
  for (const id of ["sgf", "ogf", "trail", "solid"]) $(id).addEventListener("change", () => { show.options(); redraw(); });
  $("follow").addEventListener("change", () => { followed = null; redraw(); });
  for (const button of document.querySelectorAll("[data-view]"))
    button.addEventListener("click", () => frame(button.dataset.view));
  window.addEventListener("keydown", (event) => {
    if (page.live || event.ctrlKey || event.altKey || event.metaKey) return;
    // A list opens and a slider moves by these keys; a checkbox has the space bar, and no use for arrows.
    const at = document.activeElement;
    if (at.tagName === "SELECT" || (at.tagName === "INPUT" && at.type !== "checkbox")) return;
    if (event.key === " " && ["INPUT", "BUTTON"].includes(at.tagName)) return;
    const action = {
      " ": () => setPlaying(!state.playing), ArrowRight: () => step(1), ArrowLeft: () => step(-1),
      ArrowUp: () => select(state.index - 1), ArrowDown: () => select(state.index + 1),
      ",": () => step(-1), ".": () => step(1), Home: () => jump(0), End: () => jump(1),
    }[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
  function resize() {
    renderer.setSize(window.innerWidth, window.innerHeight, false);
    camera.aspect = window.innerWidth / window.innerHeight;
    camera.updateProjectionMatrix();
    if (show) plot(page.records[state.index]);
    redraw();
  }
  window.addEventListener("resize", resize);

  let last = null;
  function tick(now) {
    requestAnimationFrame(tick);
    const took = last === null ? 0 : now - last;
    const passed = Math.min(took / 1000, 0.1);
    last = now;
    const record = page.records[state.index];
    const end = record.time[record.time.length - 1];
    orbit.update(); // tells of a change where the camera still glides
    if (heard.text) take();
    if (page.live) stale();
    if ((page.live || !state.playing) && !stale_picture) return;
    if (now < rests) return;
    if (page.live && !fine) keepUp(took);
    stale_picture = false;
    if (state.playing) {
      state.time += passed * Number($("speed").value);
      if (state.time >= end) {
        state.time = end;
        state.hold += passed;
        if (!$("loop").checked) setPlaying(false);
        else if (state.hold > 1) { state.time = record.time[0]; state.hold = 0; }
      }
    }
    const root = show.update(state.time);
    if ($("follow").checked) {
      if (followed) {
        const shift = new THREE.Vector3(root[0] - followed[0], root[1] - followed[1], 0);
        camera.position.add(shift);
        orbit.target.add(shift);
      }
      followed = root;
    }
    sun.target.position.set(root[0], root[1], 0);
    sun.position.set(root[0] - 1.6, root[1] - 2.2, 5.5);
    if (!page.live) record.events.forEach((event, i) =>
      $("events").children[i].firstChild.classList.toggle("past", event.time <= state.time));
    $("time").value = String(state.time);
    $("clock").textContent = `${state.time.toFixed(2)} / ${end.toFixed(2)} s`;
    if (!page.live) {
      show.mark(state.time);
      showPresent(record, state.time);
    }
    draw();
  }
  // Who draws by software takes every core: it rests for as long as a picture took, for others to work.
  let rests = 0;
  const pixel = new Uint8Array(4);
  function draw() {
    const begin = performance.now();
    renderer.render(stage, camera);
    if (!simple) return;
    const gl = renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // comes when the picture is there
    rests = 2 * performance.now() - begin;
  }

  // ---- a robot that lives ----------------------------------------------------------------------------------------
  const STALE_S = 0.5;
  const listeners = []; // of frames
  const heard = { at: null, over: false, text: null, last: null, mode: "waiting", tone: "", time: 0 };
  function hear() {
    document.body.classList.add("live");
    for (const mesh of show.geoms) mesh.visible = false;
    const source = new EventSource(page.live);
    // only the newest of what has come between two pictures is looked at, and nothing that is as before
    source.addEventListener("message", (message) => {
      heard.at = performance.now();
      if (message.data !== heard.last) heard.text = heard.last = message.data;
    });
    source.addEventListener("over", () => { heard.over = true; source.close(); });
  }
  function take() {
    const [record, now] = [page.records[0], JSON.parse(heard.text)];
    heard.text = null;
    const known = now.geom_pos !== undefined;
    for (const mesh of show.geoms) mesh.visible = known;
    if (known) {
      for (const key of ["geom_pos", "geom_quat", "arrow_pos", "arrow_force", "root_pos", "object_pos"])
        record[key].set(now[key]);
      show.trails[0].add(now.root_pos);
      show.trails[1].add(now.object_pos);
    } else record.arrow_force.fill(0);
    listFacts([["Policy", now.policy ?? record.policy], ["Object", now.carried ?? record.carried], ...now.facts]);
    if (JSON.stringify(now.events) !== JSON.stringify(record.events)) {
      record.events = now.events;
      tell(record);
    }
    // obstacles that move, and are shown where they are seen
    now.movers?.at.forEach((o, m) => {
      const mesh = show.obstacles[o];
      mesh.visible = now.movers.poses !== null;
      if (mesh.visible) place(mesh, now.movers.poses[m].slice(0, 3), now.movers.poses[m].slice(3));
    });
    const tone = now.tone ?? (now.mode === "damping" ? "failure" : "success");
    Object.assign(heard, { mode: now.mode, tone, time: now.time });
    for (const listener of listeners) listener(now);
    redraw();
  }
  // Where pictures of what happens now take long, without a graphics card for instance, they become simpler.
  const LONG_MS = 120;
  const SIMPLER = [() => { sun.castShadow = false; }, () => renderer.setPixelRatio(0.6), () => renderer.setPixelRatio(0.4)];
  let [long, fine] = [0, false];
  function keepUp(took) {
    long = took > LONG_MS ? long + 1 : 0;
    if (long < 3 || !SIMPLER.length) return;
    SIMPLER.shift()();
    resize();
    long = 0;
  }
  // The mode, or that nothing new has come, for a page must not look alive when its robot does not.
  function stale() {
    const silent = heard.at === null ? null : (performance.now() - heard.at) / 1000;
    const old = heard.over || silent === null || silent > STALE_S;
    $("outcome").textContent = heard.over ? "over" : silent === null ? "waiting" : old ? "no news" : heard.mode;
    $("outcome").className = "badge " + (old ? "failure" : heard.tone);
    $("distance").textContent = silent === null ? "nothing has come yet"
      : old ? `last ${heard.mode}, ${silent.toFixed(1)} s ago` : `${heard.time.toFixed(2)} s`;
  }

  // "#rollout=2&time=1.5&view=side&pause" opens the page there, and leads a page that is open there, for links and for
  // pictures of it; "plain" leaves the panels out, "fine" keeps pictures of what happens now as fine as they are.
  function obey() {
    const wish = new URLSearchParams(window.location.hash.slice(1));
    const index = Math.max(Number(wish.get("rollout") ?? state.index + 1) - 1, 0) || 0;
    if (!show || index !== state.index) select(index);
    setPlaying(!wish.has("pause"));
    const time = Number(wish.get("time") ?? NaN);
    if (Number.isFinite(time)) state.time = time;
    if (["angle", "side", "front", "top"].includes(wish.get("view"))) frame(wish.get("view"));
    document.body.classList.toggle("plain", wish.has("plain"));
    fine = wish.has("fine");
    redraw();
  }
  resize();
  obey();
  window.addEventListener("hashchange", obey);
  $("link").addEventListener("click", () => {
    const hash = `#rollout=${state.index + 1}&time=${state.time.toFixed(2)}&pause`;
    window.history.replaceState(null, "", hash);
    // Pages that were opened as files may not have a clipboard; the address bar has the link then.
    const copied = window.navigator.clipboard?.writeText(window.location.href) ?? Promise.reject(new Error("no clipboard"));
    copied.then(() => "Copied", () => "In the address bar").then((said) => {
      $("link").textContent = said;
      setTimeout(() => { $("link").textContent = "Copy link"; }, 1500);
    });
  });
  function fold(folded) {
    document.body.classList.toggle("folded", folded);
    $("fold").setAttribute("aria-expanded", String(!folded));
  }
  $("fold").addEventListener("click", () => fold(!document.body.classList.contains("folded")));
  if (window.innerWidth <= 640) fold(true); // a phone shows the robot first
  if (page.live) hear();
  // what a page beside this script steers by, see hotice/view
  if (page.steer)
    window.hotice = { page, stage, camera, orbit, geometry, redraw, canvas: renderer.domElement, show: () => show,
      listen: (listener) => listeners.push(listener) };
  requestAnimationFrame(tick);
})();
