// What rests is seen whole and sharp. What moves, because it plays or because somebody turns it, is to have 30 pictures
// a second: where a processor draws them, it has few triangles, and as many pixels as that allows.

var sharpest = software ? 2 : 1;  // [pixels] at rest for each one, each way: how a processor smooths edges
var swift = 1;                    // and in motion
var ratio, moving;                // what is drawn now
var moved = -Infinity;            // [ms] when something moved last
var pictures = -3, since;         // of a motion, and from when on [ms]
var shown = 0, told = 0;          // [s] the time of the motion that is seen, and that its slider says

function show(moves) {
  let wanted = moves ? swift : sharpest;
  if (moves === moving && wanted === ratio) return;
  moving = moves;
  ratio = wanted;
  let few = software && moves;
  viewer.scene.traverse(({geometry, userData: {whole}}) => {
    if (whole) geometry.setDrawRange(few ? whole : 0, few ? Infinity : whole);
  });
  viewer.renderer.setPixelRatio(window.devicePixelRatio * ratio);
  viewer.set_dirty();
}

// The time of a picture grows with its pixels at most in proportion. So this lowers them in a few steps, and never raises
// them so far that they had to be lowered again. The first pictures do not count: shaders are compiled for them.
function pace(now) {
  if (!viewer.animator.playing) pictures = -3;
  else if (++pictures === 0) since = now;
  if (pictures < 1 || now - since < 500) return;
  let rate = 1000 * pictures / (now - since);
  if (rate < 28 || rate > 40) swift = Math.min(1, Math.max(0.25, swift * Math.sqrt(rate / 32)));
  pictures = 0;
  since = now;
}

function look(now) {
  let {animator} = viewer;
  if (animator.time !== shown) moved = now;
  shown = animator.time;
  pace(now);
  show(now - moved < 250 && !animator.recording);
  if (shown === told || (moving && now % 250 > 50)) return;
  told = shown;
  animator.time_scrubber.updateDisplay();
}

// The slider of time follows a few times a second: to lay it out for each picture takes as long as all other scripts.
viewer.animator.display_progress = function (time) { this.time = time; };
viewer.controls.addEventListener("change", () => { moved = performance.now(); });
document.addEventListener("visibilitychange", () => { pictures = -3; });
viewer.animate = function () {
  requestAnimationFrame(() => viewer.animate());
  viewer.animator.update();
  look(performance.now());
  if (viewer.needs_render) viewer.render();
};
show(viewer.animator.playing);
viewer.animate();
