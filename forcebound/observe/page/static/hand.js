// Mouse, pen, fingers and keys on the scene: they move the hand's target, or turn and zoom the view.

const MM = 1e-3;
const STEPS = { ArrowLeft: [-MM, 0, 0], ArrowRight: [MM, 0, 0], ArrowUp: [0, MM, 0], ArrowDown: [0, -MM, 0],
  PageUp: [0, 0, MM], PageDown: [0, 0, -MM] };
const TURN = 0.01; // rad for each pixel

/** Listen to what one does on a scene. One pointer drags the hand; two, or Shift, turn and zoom. */
export function listen(scene) {
  const { canvas } = scene;
  const down = new Map(); // pointer -> where it is, in pixels
  let turns = false;

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (!down.size) turns = event.button === 2 || event.shiftKey || !scene.hand;
    down.set(event.pointerId, [event.clientX, event.clientY]);
    if (down.size > 1) turns = true;
    if (!turns) scene.grasp([event.offsetX, event.offsetY]);
  });
  const moved = (event) => {
    const before = down.get(event.pointerId);
    if (!canvas.hasPointerCapture(event.pointerId)) down.delete(event.pointerId); // the event of its loss comes late, or never
    else if (before && (before[0] !== event.clientX || before[1] !== event.clientY)) move(event, before);
  };
  const move = (event, before) => {
    const spread = () => { const [a, b] = [...down.values()]; return b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0; };
    const wide = spread(), [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    down.set(event.pointerId, [event.clientX, event.clientY]);
    if (!turns) scene.move([dx / scene.scale, -dy / scene.scale, 0], event.timeStamp);
    else {
      if (wide > 0 && spread() > 0) scene.zoom(wide / spread());
      scene.turn(-dx * TURN / down.size, dy * TURN / down.size);
    }
  };
  canvas.addEventListener("pointermove", moved);
  canvas.addEventListener("pointerrawupdate", moved); // where there is one, it does not wait for the next picture
  canvas.addEventListener("lostpointercapture", (event) => down.delete(event.pointerId)); // however it has ended
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    scene.zoom(1.1 ** Math.sign(event.deltaY));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return; // these are the browser's
    const step = STEPS[event.key];
    if (event.key === "+" || event.key === "=") scene.zoom(0.8);
    else if (event.key === "-") scene.zoom(1.25);
    else if (step && (event.shiftKey || !scene.hand)) scene.turn(-step[0] * 100, step[1] * 100);
    else if (step) {
      scene.grasp();
      scene.move(step, event.timeStamp);
    } else return;
    event.preventDefault();
  });
}
