// Steers a simulation: sends what is dragged, pushed and chosen, and draws ways and a slice of the fields. Every order is
// checked by the server; what it refuses is told here. Units are metres and seconds, z is up.
"use strict";
(() => {
  if (!window.hotice) return; // no WebGL: the viewer has said so
  const { page, show, stage, camera, orbit, canvas, listen, redraw, geometry } = window.hotice;
  const steer = page.steer;
  const $ = (id) => document.getElementById(id);
  const COLORS = { sgf: 0x1f6fe5, ogf: 0xe8710a };
  const NUDGE_M = 0.1;
  const NUDGE_PUSH = 0.4; // [m/s]
  const MOST_PUSH = 1.0; // [m/s], of a drag of as many metres
  const INSIDE = 999; // an angle that is none
  document.body.classList.add("steered");

  // ---- orders ----------------------------------------------------------------------------------------------------
  let quiet = null;
  function tell(text) {
    $("told").hidden = !text;
    $("told").textContent = text;
    clearTimeout(quiet);
    if (text) quiet = setTimeout(() => tell(""), 6000);
  }
  async function ask(order) {
    try {
      const answer = await fetch(steer.orders, {
        method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(order) });
      if (!answer.ok) tell((await answer.json()).error);
    } catch {
      tell("The simulation does not answer: was it ended?");
    }
  }
  // Of what is dragged the newest place is sent, one at a time.
  const places = new Map();
  let sending = false;
  async function bring(name, to) {
    places.set(name, to);
    if (sending) return;
    sending = true;
    while (places.size) {
      const [obstacle, place] = places.entries().next().value;
      places.delete(obstacle);
      await ask({ order: "move", obstacle, to: place });
    }
    sending = false;
  }
  const within = ([x, y, z]) => [x, y, z].map((v, k) => Math.min(Math.max(v, steer.low[k]), steer.high[k]));

  // ---- hands: drag an obstacle, push the robot -----------------------------------------------------------------------
  const caster = new THREE.Raycaster();
  let held = null;
  function ray(event) {
    const frame = canvas.getBoundingClientRect();
    const [x, y] = [(event.clientX - frame.left) / frame.width, (event.clientY - frame.top) / frame.height];
    caster.setFromCamera(new THREE.Vector2(2 * x - 1, 1 - 2 * y), camera);
    return caster;
  }
  // The first solid under the pointer: an obstacle, or part of robot and object.
  function under(event) {
    const { obstacles, geoms } = show();
    const [hit] = ray(event).intersectObjects([...obstacles, ...geoms.filter((mesh) => mesh.visible)], false);
    return hit && { mesh: hit.object, point: hit.point.clone(), obstacle: obstacles.includes(hit.object) };
  }
  // Drags go over the floor's plane through the point that was taken, or upright, towards the camera.
  function planeOf(point, upright) {
    const view = camera.getWorldDirection(new THREE.Vector3());
    const flat = new THREE.Vector3(view.x, view.y, 0).normalize();
    const normal = upright || Math.abs(view.z) < 0.12 ? flat : new THREE.Vector3(0, 0, 1);
    return new THREE.Plane().setFromNormalAndCoplanarPoint(normal, point);
  }
  const ghost = new THREE.LineSegments(undefined, new THREE.LineBasicMaterial({ color: 0x1d2733 }));
  const shove = new THREE.ArrowHelper(new THREE.Vector3(1, 0, 0), new THREE.Vector3(), 0.1, 0x1d2733);
  ghost.visible = shove.visible = false;
  ghost.frustumCulled = false;
  stage.add(ghost, shove);

  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !event.isPrimary) return;
    const hit = under(event);
    if (!hit) return;
    orbit.enabled = false;
    canvas.setPointerCapture(event.pointerId);
    canvas.className = "grabbing";
    held = { ...hit, upright: event.shiftKey, plane: planeOf(hit.point, event.shiftKey), from: hit.mesh.position.clone() };
    if (!hit.obstacle) return;
    ghost.geometry = new THREE.EdgesGeometry(hit.mesh.geometry, 30);
    ghost.position.copy(hit.mesh.position);
    ghost.quaternion.copy(hit.mesh.quaternion);
    $("what").value = hit.mesh.name;
  }, { capture: true });
  canvas.addEventListener("pointermove", (event) => {
    if (!held) {
      if (event.pointerType === "mouse" && !event.buttons) canvas.className = under(event) ? "grab" : "";
      return;
    }
    const at = ray(event).ray.intersectPlane(held.plane, new THREE.Vector3());
    if (!at) return;
    held.way = at.sub(held.point);
    if (held.obstacle) {
      if (!held.upright) held.way.z = 0;
      const to = within(held.from.clone().add(held.way).toArray());
      ghost.visible = true;
      ghost.position.set(...to);
      bring(held.mesh.name, to);
    } else {
      held.way.z = 0;
      const [length, direction] = [Math.min(held.way.length(), MOST_PUSH), held.way.clone().normalize()];
      shove.visible = length > 0.02;
      shove.position.copy(held.point);
      shove.setDirection(direction);
      shove.setLength(Math.max(length, 0.03), 0.12, 0.07);
    }
    redraw();
  });
  function letGo(event) {
    if (!held) return;
    if (event.type === "pointerup" && !held.obstacle) {
      const away = camera.getWorldDirection(new THREE.Vector3()).setZ(0).normalize().multiplyScalar(NUDGE_PUSH);
      const dragged = held.way && held.way.length() > 0.05;
      push(dragged ? held.way.clone().clampLength(0, MOST_PUSH) : away);
    }
    held = null;
    ghost.visible = shove.visible = false;
    canvas.className = "";
    orbit.enabled = true;
    redraw();
  }
  canvas.addEventListener("pointerup", letGo);
  canvas.addEventListener("pointercancel", letGo);
  const push = (velocity) => ask({ order: "push", velocity: [velocity.x, velocity.y] });

  // ---- the panel -------------------------------------------------------------------------------------------------------
  function choose(select, names, first) {
    select.replaceChildren(...[...(first ? [first] : []), ...names.map((name) => [name, name])].map(([value, text]) => {
      const option = document.createElement("option");
      [option.value, option.textContent] = [value, text];
      return option;
    }));
  }
  choose($("what"), steer.obstacles, ["", "the robot (push)"]);
  choose($("policy"), steer.policies);
  [$("height").min, $("height").max] = [steer.low[2], steer.high[2]];
  $("height").value = 0.75;

  // The arrows go as seen from the camera, along the axis of the world that is nearest.
  function along(go) {
    const view = camera.getWorldDirection(new THREE.Vector3()).setZ(0);
    const away = Math.abs(view.x) > Math.abs(view.y) ? [Math.sign(view.x), 0] : [0, Math.sign(view.y)];
    const right = [away[1], -away[0]];
    const [sign, [x, y]] = { away: [1, away], near: [-1, away], right: [1, right], left: [-1, right] }[go];
    return new THREE.Vector3(sign * x, sign * y, 0);
  }
  for (const button of document.querySelectorAll("[data-go]"))
    button.addEventListener("click", () => {
      const way = along(button.dataset.go);
      const mesh = show().obstacles.find((each) => each.name === $("what").value);
      if (!mesh) push(way.multiplyScalar(NUDGE_PUSH));
      else bring(mesh.name, within(mesh.position.clone().addScaledVector(way, NUDGE_M).toArray()));
    });
  $("pause").addEventListener("click", () => ask({ order: "pause", on: !chosen.paused }));
  $("restart").addEventListener("click", () => ask({ order: "restart" }));
  $("restore").addEventListener("click", () => ask({ order: "restore" }));
  $("policy").addEventListener("change", () => ask({ order: "policy", policy: $("policy").value }));
  $("noise").addEventListener("change", () => ask({ order: "noise", on: $("noise").checked }));
  function slice() {
    $("height-m").textContent = `${Number($("height").value).toFixed(2)} m`;
    ask({ order: "slice", field: $("slice").value, height: Number($("height").value) });
  }
  $("slice").addEventListener("change", slice);
  $("height").addEventListener("change", slice);
  $("height").addEventListener("input", () => { $("height-m").textContent = `${Number($("height").value).toFixed(2)} m`; });

  // Extents are given in centimetres; a round object has a diameter.
  const SIZES = { box: ["length", "width", "height"], cylinder: ["diameter", "height"], sphere: ["diameter"] };
  function sizes(shape, values) {
    $("sizes").replaceChildren(...SIZES[shape].flatMap((name, i) => {
      const input = document.createElement("input");
      Object.assign(input, { type: "number", min: 5, max: 60, step: 1, value: values[i] ?? 30 });
      input.setAttribute("aria-label", `${name} of the object in centimetres`);
      input.title = `${name} [cm]`;
      return i ? ["×", input] : [input];
    }), "cm");
  }
  function showObject(object) {
    const cm = (v) => Math.round(100 * v);
    $("shape").value = object.shape;
    $("mass").value = object.mass_kg;
    sizes(object.shape, { box: () => object.size_m.map(cm), sphere: () => [cm(2 * object.radius_m)],
      cylinder: () => [cm(2 * object.radius_m), cm(object.length_m)] }[object.shape]());
  }
  $("shape").addEventListener("change", () => sizes($("shape").value, []));
  $("take").addEventListener("click", () => {
    const [a, b, c] = [...$("sizes").querySelectorAll("input")].map((input) => Number(input.value) / 100);
    const [shape, mass_kg] = [$("shape").value, Number($("mass").value)];
    const object = { box: { shape, size_m: [a, b, c], mass_kg }, sphere: { shape, radius_m: a / 2, mass_kg },
      cylinder: { shape, radius_m: a / 2, length_m: b, mass_kg } }[shape];
    ask({ order: "take", object });
  });

  // ---- frames: obstacles, ways, slice, what is chosen ----------------------------------------------------------------------
  const dots = Object.fromEntries(Object.entries(COLORS).map(([field, color]) => {
    const mesh = new THREE.InstancedMesh(new THREE.SphereGeometry(0.012, 10, 8), new THREE.MeshBasicMaterial({ color }), 600);
    mesh.frustumCulled = false;
    stage.add(mesh);
    return [field, mesh];
  }));
  // arrows of the slice, along x: shafts and heads
  const needles = [
    new THREE.CylinderGeometry(0.003, 0.003, 0.05, 6).translate(0, -0.01, 0), new THREE.ConeGeometry(0.011, 0.032, 8).translate(0, 0.03, 0),
  ].map((shape) => {
    const mesh = new THREE.InstancedMesh(shape.rotateZ(-Math.PI / 2), new THREE.MeshBasicMaterial(), 1200);
    mesh.frustumCulled = mesh.visible = false;
    stage.add(mesh);
    return mesh;
  });
  const matrix = new THREE.Matrix4();
  function drawWays(ways) {
    for (const [field, mesh] of Object.entries(dots)) {
      const points = ways.filter((way) => way.field === field).flatMap((way) => way.points);
      mesh.count = Math.min(points.length / 3, 600);
      mesh.visible = $("ways").checked && $(field).checked;
      for (let i = 0; i < mesh.count; i++) mesh.setMatrixAt(i, matrix.makeTranslation(...points.slice(3 * i, 3 * i + 3)));
      mesh.instanceMatrix.needsUpdate = true;
    }
  }
  function drawSlice(cut) {
    for (const mesh of needles) mesh.visible = cut !== null;
    if (!cut) return;
    let count = 0;
    cut.angles.forEach((angle, i) => {
      if (angle === INSIDE) return;
      const [column, row] = [i % cut.columns, Math.floor(i / cut.columns)];
      matrix.makeRotationZ(angle * Math.PI / 180);
      matrix.setPosition(cut.first[0] + cut.spacing * column, cut.first[1] + cut.spacing * row, cut.height);
      for (const mesh of needles) mesh.setMatrixAt(count, matrix);
      count++;
    });
    for (const mesh of needles) {
      mesh.material.color.setHex(COLORS[cut.field]);
      mesh.count = count;
      mesh.instanceMatrix.needsUpdate = true;
    }
  }
  const key = document.createElement("label");
  key.innerHTML = '<input type="checkbox" id="ways" checked><i class="key way"></i>Planned ways';
  $("trail").parentElement.before(key);

  let chosen = {};
  let [objectShown, shapeShown] = ["", ""];
  listen((now) => {
    const { obstacles, geoms } = show();
    const touching = new Set(now.touching);
    obstacles.forEach((mesh, i) => {
      const [x, y, z, w, a, b, c] = now.obstacles[i];
      mesh.position.set(x, y, z);
      mesh.quaternion.set(a, b, c, w);
    });
    for (const mesh of [...obstacles, ...geoms]) mesh.material.emissive.setHex(touching.has(mesh.name) ? 0xc80014 : 0);
    const shape = JSON.stringify(now.object);
    if (shape !== shapeShown) {
      shapeShown = shape;
      show().reshape(geometry(now.object.type, now.object.size));
    }
    drawWays(now.ways);
    drawSlice(now.slice);
    chosen = now.chosen;
    $("pause").textContent = chosen.paused ? "▶ Go on" : "❚❚ Pause";
    $("pause").setAttribute("aria-pressed", String(chosen.paused));
    if (document.activeElement !== $("policy")) $("policy").value = chosen.policy;
    $("noise").checked = chosen.noise;
    const object = JSON.stringify(chosen.object);
    if (object !== objectShown) showObject(chosen.object);
    objectShown = object;
    Object.assign(canvas.dataset, { version: now.version, behind: now.behind, time: now.time, mode: now.mode });
  });
})();
