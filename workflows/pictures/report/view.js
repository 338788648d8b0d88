// The 3D view: reads the data of the page (see report_view.py) and draws when something has changed, not all the time.
"use strict";
(() => {
  const model = JSON.parse(document.getElementById("model").textContent);
  const $ = (id) => document.getElementById(id);
  const TYPES = { float32: Float32Array, uint32: Uint32Array, uint16: Uint16Array, int16: Int16Array, uint8: Uint8Array, int8: Int8Array };
  const SVG = "http://www.w3.org/2000/svg";
  const GREY = [0.8, 0.81, 0.83];

  function unpacked(array) {
    const bytes = Uint8Array.from(atob(array.data), (letter) => letter.charCodeAt(0));
    const numbers = new TYPES[array.type](bytes.buffer);
    return array.scale === undefined ? numbers : Float32Array.from(numbers, (number) => number * array.scale);
  }

  const points = unpacked(model.points), faces = unpacked(model.faces), owners = unpacked(model.owners), width = model.width;
  const contacts = model.contacts.map((c) => ({ name: c.name, nodes: unpacked(c.nodes), facets: unpacked(c.facets) }));
  const frames = model.frames.map((f) => ({
    time: f.time, index: f.index, displacement: unpacked(f.displacement), stress: unpacked(f.stress),
    obstacles: model.obstacles.map((o) => unpacked(f.obstacles[o.name])),
    contacts: contacts.map((c) => f.contacts[c.name] && { pressure: unpacked(f.contacts[c.name].pressure), status: unpacked(f.contacts[c.name].status) }),
  }));
  const length = (u, node) => Math.hypot(u[3 * node], u[3 * node + 1], u[3 * node + 2]);
  const largest = (of) => frames.reduce((most, frame) => of(frame).reduce((a, b) => Math.max(a, b), most), 0);
  const QUANTITIES = {
    "displacement": { unit: model.units.m, most: largest((f) => Float32Array.from({ length: points.length / 3 }, (_, k) => length(f.displacement, k))) },
    "von Mises stress": { unit: model.units.Pa, most: largest((f) => f.stress) },
    "contact pressure": { unit: model.units.Pa, most: Math.max(0, ...contacts.map((_, k) => largest((f) => (f.contacts[k] ? f.contacts[k].pressure : [])))) },
    "contact status": {},
  };
  const box = new THREE.Box3().setFromArray(points);
  const size = box.getSize(new THREE.Vector3()).length(), centre = box.getCenter(new THREE.Vector3());

  function shade(value, most) {
    const place = Math.min(1, Math.max(0, most > 0 ? value / most : 0)) * (model.shades.length - 1);
    const low = Math.min(Math.floor(place), model.shades.length - 2), part = place - low;
    return model.shades[low].map((number, k) => (number + part * (model.shades[low + 1][k] - number)) / 255);
  }
  const told = (value) => (value !== 0 && (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e5) ? value.toExponential(3).replace("e+", "e") : `${Number(value.toPrecision(4))}`);
  const hex = (colour) => [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16) / 255);
  const statuses = Object.fromEntries(Object.entries(model.statuses).map(([key, [, colour]]) => [key, hex(colour)]));

  // The scene
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ canvas: $("canvas"), antialias: true, preserveDrawingBuffer: true }); // kept to be printed
  } catch (error) {
    $("failed").hidden = false;
    return;
  }
  THREE.ColorManagement.enabled = false; // colours are those of the legend
  renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
  renderer.setPixelRatio(Math.max(window.devicePixelRatio, 1.5));
  renderer.setClearColor(0xffffff);
  const scene = new THREE.Scene(), camera = new THREE.OrthographicCamera(-1, 1, 1, -1, -10 * size, 10 * size);
  const controls = new OrbitControls(camera, $("canvas"));
  controls.addEventListener("change", draw);
  const light = new THREE.DirectionalLight(0xffffff, 1.4);
  scene.add(new THREE.AmbientLight(0xffffff, 1.7), light);

  const Material = model.solid ? THREE.MeshLambertMaterial : THREE.MeshBasicMaterial;
  const looks = { vertexColors: true, side: THREE.DoubleSide, flatShading: true, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 };
  if (!model.solid) delete looks.flatShading;
  // One mesh a body, of triangles that share no nodes: stress is constant in a face
  const bodies = model.bodies.map((name, number) => {
    const corners = [], cells = [], edges = new Map();
    for (let face = 0; face < owners.length; face++) {
      if (owners[face] !== number) continue;
      const nodes = Array.from(faces.subarray(width * face, width * face + width));
      for (const three of width === 4 ? [[0, 1, 2], [0, 2, 3]] : [[0, 1, 2]]) { corners.push(...three.map((k) => nodes[k])); cells.push(face, face, face); }
      nodes.forEach((node, k) => {
        const next = nodes[(k + 1) % width], key = node < next ? `${node} ${next}` : `${next} ${node}`;
        edges.set(key, [...(edges.get(key) || []), face]);
      });
    }
    const ends = [...edges.keys()].flatMap((key) => key.split(" ").map(Number));
    const sharp = [...edges].filter(([, both]) => isSharp(both)).flatMap(([key]) => key.split(" ").map(Number));
    const body = { name, corners, cells, shown: true };
    body.mesh = new THREE.Mesh(filled(corners.length, true), new Material({ ...looks }));
    body.lines = new THREE.LineSegments(filled(ends.length), new THREE.LineBasicMaterial({ color: 0x000000, transparent: true, opacity: 0.25 }));
    body.outline = new THREE.LineSegments(filled(sharp.length), new THREE.LineBasicMaterial({ color: 0x333333 }));
    body.rest = new THREE.LineSegments(filled(sharp.length), new THREE.LineBasicMaterial({ color: 0x999999 }));
    Object.assign(body, { ends, sharp });
    place(body.rest, sharp, (node, k) => points[3 * node + k]);
    scene.add(body.mesh, body.lines, body.outline, body.rest);
    return body;
  });
  // Rigid obstacles: translucent surfaces, of plane models lines
  const rigid = model.obstacles.map((obstacle) => {
    const corners = Array.from(unpacked(obstacle.pieces)), at = unpacked(obstacle.points);
    const look = { color: 0x888888, side: THREE.DoubleSide, transparent: true, opacity: 0.3, depthWrite: false };
    const object = model.solid ? new THREE.Mesh(filled(corners.length), new THREE.MeshBasicMaterial(look))
      : new THREE.LineSegments(filled(corners.length), new THREE.LineBasicMaterial({ color: 0x555555 }));
    scene.add(object);
    return { object, corners, at };
  });
  // A facet is cut into the parts next to each node, so that each can have the colour of its node's status
  const corner = (k) => [0, 1, 2].map((j) => Number(j === k)), mean = (...all) => [0, 1, 2].map((k) => all.reduce((sum, one) => sum + one[k], 0) / all.length);
  const middle = mean(corner(0), corner(1), corner(2));
  const PARTS = model.pieceWidth === 3
    ? [0, 1, 2].flatMap((k) => [1, 2].map((turn) => ({ node: k, ends: [corner(k), mean(corner(k), corner((k + turn) % 3)), middle] })))
    : [0, 1].map((k) => ({ node: k, ends: [corner(k), mean(corner(0), corner(1))] }));
  const sides = contacts.map((contact) => {
    const count = PARTS.length * contact.facets.length / model.pieceWidth * (model.pieceWidth === 3 ? 3 : 6); // a segment is a ribbon of two triangles
    const mesh = new THREE.Mesh(filled(count, true), new THREE.MeshBasicMaterial({ vertexColors: true, side: THREE.DoubleSide }));
    scene.add(mesh);
    return { ...contact, mesh };
  });

  function filled(count, coloured) {
    const geometry = new THREE.BufferGeometry();
    for (const name of coloured ? ["position", "color"] : ["position"]) geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * count), 3));
    return geometry;
  }
  function normal(face) {
    const [a, b, c] = [0, 1, 2].map((k) => new THREE.Vector3().fromArray(points, 3 * faces[width * face + k]));
    return b.sub(a).cross(c.sub(a)).normalize();
  }
  function isSharp(both) {
    return both.length !== 2 || (model.solid && Math.abs(normal(both[0]).dot(normal(both[1]))) < 0.8);
  }
  function place(object, nodes, coordinate) {
    const target = object.geometry.attributes.position;
    nodes.forEach((node, at) => { for (let k = 0; k < 3; k++) target.array[3 * at + k] = coordinate(node, k); });
    target.needsUpdate = true;
    object.geometry.computeBoundingSphere();
  }

  // What the controls say
  function update() {
    const frame = frames[Number($("time").value)], factor = model.factors.values[Number($("factor").value)];
    const quantity = $("quantity").value, { most } = QUANTITIES[quantity], u = frame.displacement;
    const moved = (node, k) => points[3 * node + k] + factor * u[3 * node + k];
    const onContact = quantity.startsWith("contact");
    $("told-time").value = `${frame.index}: t = ${told(frame.time)} s`;
    $("told-factor").value = told(factor);
    for (const body of bodies) {
      place(body.mesh, body.corners, moved);
      place(body.lines, body.ends, moved);
      place(body.outline, body.sharp, moved);
      const colours = body.mesh.geometry.attributes.color;
      body.corners.forEach((node, at) => {
        const colour = onContact ? GREY : shade(quantity === "displacement" ? length(u, node) : frame.stress[body.cells[at]], most);
        colours.array.set(colour, 3 * at);
      });
      colours.needsUpdate = true;
      const glass = onContact && model.solid; // contact sides lie between bodies
      Object.assign(body.mesh.material, { transparent: glass, opacity: glass ? 0.22 : 1, depthWrite: !glass, needsUpdate: true });
      body.mesh.visible = body.outline.visible = body.shown;
      body.lines.visible = body.shown && $("lines").checked;
      body.rest.visible = body.shown && $("rest").checked;
    }
    rigid.forEach(({ object, corners, at }, number) => { // each frame has the translation, then the rows of a linear map
      const map = frame.obstacles[number];
      const motion = (node, k) => [0, 1, 2].reduce((sum, j) => sum + map[3 + 3 * k + j] * at[3 * node + j], map[k]);
      place(object, corners, (node, k) => at[3 * node + k] + factor * motion(node, k));
    });
    sides.forEach((side, number) => {
      const values = frame.contacts[number];
      side.mesh.visible = onContact && Boolean(values);
      if (!side.mesh.visible) return;
      const target = side.mesh.geometry.attributes, half = 0.006 * size;
      let drawn = 0;
      const put = (position, colour) => { target.position.array.set(position, drawn); target.color.array.set(colour, drawn); drawn += 3; };
      for (let first = 0; first < side.facets.length; first += model.pieceWidth) {
        const nodes = side.facets.subarray(first, first + model.pieceWidth);
        const blend = (weights, value) => nodes.reduce((sum, node, k) => sum + weights[k] * value(node), 0);
        for (const part of PARTS) {
          const ends = part.ends.map((weights) => [0, 1, 2].map((k) => blend(weights, (node) => moved(side.nodes[node], k))));
          const colours = part.ends.map((weights) => (quantity === "contact status"
            ? statuses[values.status[nodes[part.node]]] : shade(blend(weights, (node) => values.pressure[node]), most)));
          if (ends.length === 3) {
            ends.forEach((end, k) => put(end, colours[k]));
          } else {
            const [p, q] = ends, across = Math.hypot(q[1] - p[1], q[0] - p[0]) || 1;
            const n = [half * (q[1] - p[1]) / across, half * (p[0] - q[0]) / across];
            for (const [k, sign] of [[0, 1], [0, -1], [1, 1], [0, -1], [1, -1], [1, 1]]) {
              put([ends[k][0] + sign * n[0], ends[k][1] + sign * n[1], ends[k][2] + 0.002 * size], colours[k]);
            }
          }
        }
      }
      for (const name of ["position", "color"]) side.mesh.geometry.attributes[name].needsUpdate = true;
      side.mesh.geometry.computeBoundingSphere();
    });
    const where = document.createElement("span"); // in print the controls are hidden
    where.className = "where";
    where.append(`t = ${told(frame.time)} s, displacement × ${told(factor)}`);
    $("legend").replaceChildren(...legend(quantity), where);
    draw();
  }
  function legend(quantity) {
    const text = (words) => document.createTextNode(words), { unit, most } = QUANTITIES[quantity];
    if (!unit) {
      return Object.values(model.statuses).map(([word, colour]) => {
        const item = document.createElement("span"), swatch = document.createElement("i");
        swatch.style.background = colour;
        item.append(swatch, text(word));
        return item;
      });
    }
    const bar = document.createElement("span"), name = document.createElement("b");
    bar.className = "bar";
    bar.style.background = `linear-gradient(to right, ${model.shades.map((shade) => `rgb(${shade})`)})`;
    name.append(text(`${quantity} [${unit}]`));
    return [name, text("0"), bar, text(`${told(most)}, the largest of all steps shown`)];
  }
  let reach = [size / 2, size / 2]; // of all that is drawn, from the centre of the picture
  function draw() {
    light.position.copy(camera.position).sub(controls.target);
    renderer.render(scene, camera);
    const turned = camera.quaternion.clone().invert();
    $("axes").replaceChildren(...["x", "y", "z"].slice(0, model.solid ? 3 : 2).flatMap((name, k) => {
      const tip = new THREE.Vector3().setComponent(k, 1).applyQuaternion(turned), line = document.createElementNS(SVG, "path"), text = document.createElementNS(SVG, "text");
      line.setAttribute("d", `M40 40L${40 + 24 * tip.x} ${40 - 24 * tip.y}`);
      Object.entries({ x: 40 + 33 * tip.x, y: 44 - 33 * tip.y }).forEach(([key, value]) => text.setAttribute(key, value));
      text.textContent = name;
      return [line, text];
    }));
  }
  function fit() {
    const { clientWidth: wide, clientHeight: high } = $("stage");
    if (!wide || !high) return;
    renderer.setSize(wide, high, false);
    const half = 1.08 * Math.max(reach[1], (reach[0] * high) / wide); // also on paper, which is narrower
    Object.assign(camera, { left: -half * wide / high, right: half * wide / high, top: half, bottom: -half });
    camera.updateProjectionMatrix();
    draw();
  }
  function home() {
    camera.up.set(0, model.solid ? 0 : 1, model.solid ? 1 : 0);
    camera.position.copy(centre).add(model.solid ? new THREE.Vector3(1, -1.6, 0.9).setLength(2 * size) : new THREE.Vector3(0, 0, 2 * size));
    controls.target.copy(centre);
    camera.zoom = 1;
    camera.lookAt(centre);
    camera.updateMatrixWorld();
    // the window: all that is drawn in the last step, seen from here
    const factor = model.factors.values[Number($("factor").value)], seen = new THREE.Vector3();
    reach = [0, 0];
    for (const u of [frames[0].displacement, frames[frames.length - 1].displacement]) {
      for (let node = 0; node < points.length / 3; node++) {
        seen.fromArray([0, 1, 2].map((k) => points[3 * node + k] + factor * u[3 * node + k])).applyMatrix4(camera.matrixWorldInverse);
        [seen.x, seen.y].forEach((value, k) => { reach[k] = Math.max(reach[k], Math.abs(value)); });
      }
    }
    controls.update();
    fit();
  }

  // The controls
  for (const name of Object.keys(QUANTITIES)) if (!name.startsWith("contact") || contacts.length) $("quantity").add(new Option(name));
  for (const body of bodies.length > 1 ? bodies : []) {
    const label = document.createElement("label"), tick = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
    tick.addEventListener("change", () => { body.shown = tick.checked; update(); });
    label.append(tick, ` ${body.name}`);
    $("parts").append(label);
  }
  Object.assign($("time"), { max: frames.length - 1, value: frames.length - 1 });
  Object.assign($("factor"), { max: model.factors.values.length - 1, value: model.factors.start });
  for (const id of ["time", "factor", "quantity", "lines", "rest"]) $(id).addEventListener("input", update);
  $("home").addEventListener("click", home);
  for (const element of [$("time").parentElement, $("play")]) element.hidden = frames.length === 1;
  let playing = null;
  $("play").addEventListener("click", () => {
    if (playing) clearInterval(playing);
    playing = playing ? null : setInterval(() => { $("time").value = (Number($("time").value) + 1) % frames.length; update(); }, Math.min(600, 8000 / frames.length));
    $("play").textContent = playing ? "stop" : "play";
  });
  new ResizeObserver(fit).observe($("stage"));
  window.addEventListener("beforeprint", fit);
  update();
  home();
})();
