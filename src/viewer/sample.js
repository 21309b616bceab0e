// A scan to try the service with: a pebble with bumps, evenly sampled.

export function sampleFile(count = 4000) {
  const lines = [];
  for (let i = 0; i < count; i += 1) {
    // Fibonacci's spiral [González 2010, Mathematical Geosciences 42(1)].
    const z = 1 - (2 * i + 1) / count;
    const turn = i * Math.PI * (3 - Math.sqrt(5));
    const flat = Math.sqrt(1 - z * z);
    const [x, y] = [flat * Math.cos(turn), flat * Math.sin(turn)];
    const radius = 1 + 0.22 * Math.cos(5 * turn) * flat ** 5 + 0.3 * Math.abs(z) ** 9 + 0.1 * Math.sin(2.5 * z + x);
    lines.push([1.35 * x, 1.1 * y, 0.8 * z].map((a) => (a * radius).toFixed(6)).join(' '));
  }
  return new File([lines.join('\n') + '\n'], 'pebble.xyz');
}
