// What rests is seen whole and sharp. What moves, because it plays or because somebody turns it,
// is to have 30 pictures a second: where a processor draws them it has few triangles, for these
// take most of the time, and then as many pixels as that allows.

var sharpest = software ? 2 : 1;  // [pixels for each one, each way] at rest: smooth edges
var swift = software ? 0.5 : 1;   // and in motion, until its pictures are counted
var ratio, moving;                // what is drawn now
var moved = -Infinity;            // [ms] when something moved last
var pictures = -3, since;         // of the motion, and since when [ms]
var shown = 0;                    // [s] the time of the motion that is seen
var told = {time: 0, at: 0};      // [s] what its slider says, [ms] and since when

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

// The time of a picture grows at most as its pixels do. So these are lowered in a few steps, and
// never raised so far that they had to be lowered again. The first pictures do not count: shaders
// are compiled for them.
function pace(now) {
  if (!viewer.animator.playing) pictures = -3;
  else if (++pictures === 0) since = now;
  if (pictures < 1 || now - since < 500) return;
  let rate = 1000 * pictures / (now - since);
  let wanted = swift * Math.sqrt(rate / 34);
  if (rate < 30 || rate > 42) swift = Math.min(1, Math.max(0.25, wanted));
  pictures = 0;
  since = now;
}

// The slider of time follows a few times a second: to lay it out for each picture takes as long
// as all else in the page that is not drawn by the renderer.
function tell(now) {
  let plays = viewer.animator.playing;
  if ((shown === told.time && plays === told.plays) || (moving && now - told.at < 250)) return;
  told = {time: shown, at: now, plays};
  viewer.animator.time_scrubber.updateDisplay();
  let bar = document.getElementById("player");
  if (bar.tell) bar.tell(shown);
}

function look(now) {
  let {time, recording} = viewer.animator;
  if (time !== shown) moved = now;
  shown = time;
  pace(now);
  show(now - moved < 250 && !recording);
  tell(now);
}

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
