// How well the picture is drawn: plainer where pictures come too seldom, better again where there is time.

const SEVERAL = 3, SLOW_FPS = 24, EASY_FPS = 50, WORTH_FPS = 40;  // what is better must also be smooth
const LEVELS = [
  { ratio: 2, shadows: true, still: false, coarse: false },
  { ratio: 1, shadows: true, still: false, coarse: false },
  { ratio: 1, shadows: false, still: true, coarse: false },
  { ratio: 1, shadows: false, still: true, coarse: true },
  { ratio: 0.7, shadows: false, still: true, coarse: true },
];
const OF_PROCESSORS = 3;

export class Quality {
  /** @param {boolean} slow a processor draws  @param {number} density pixels of the screen for one of the page */
  constructor(slow, density) {
    this.density = density;
    this.level = slow ? OF_PROCESSORS : 0;
    this.best = slow ? OF_PROCESSORS - 1 : 0;  // no better level is tried: it was too slow
    this.easy = 0;
  }

  /** ratio (pixels for one of the page), shadows, still (the room is kept as a picture), coarse (meshes). */
  get now() {
    const level = LEVELS[this.level];
    return { ...level, ratio: Math.min(this.density, level.ratio) };
  }

  /** Whether another level is drawn from now on, after a stretch at so many pictures a second. */
  judge(rate) {
    const before = this.level;
    this.easy = rate > EASY_FPS ? this.easy + 1 : 0;
    if (rate < (this.risen ? WORTH_FPS : SLOW_FPS) && before < LEVELS.length - 1) {
      this.level += before === 0 && this.density <= 1 ? 2 : 1;  // where a ratio of 2 is one of 1
      this.best = this.level;
      this.risen = false;
    } else if (this.easy >= SEVERAL && before > this.best) {
      this.level -= 1;
      this.easy = 0;
      this.risen = true;
    }
    return this.level !== before;
  }
}
