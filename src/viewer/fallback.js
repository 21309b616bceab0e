// Without WebGL 2: the service's own pictures, with the same controls as links.

import { request } from './api.js';
import { find, make } from './dom.js';
import { imagePath } from './keep.js';
import { change, fragment, view } from './state.js';

const TURN = 30;
const TILT = 15;

/** Shows the view as a picture of the service, and links to the views beside it. */
export async function showPicture(modes) {
  const box = find('pictures');
  box.hidden = false;
  const answer = await request(imagePath(modes));
  const image = make('img', { src: URL.createObjectURL(await answer.blob()), alt: `The cloud, ${view.color === 'basis' ? `mode ${view.basis}` : view.color}` });
  image.addEventListener('load', () => URL.revokeObjectURL(image.src));
  const to = (words, parts) => {
    const before = { ...view };
    Object.assign(view, parts);
    const link = make('a', { href: `#${fragment()}` }, words);
    Object.assign(view, before);
    link.addEventListener('click', (event) => { event.preventDefault(); change(parts); });
    return link;
  };
  const links = [
    to('turn left', { azimuth: view.azimuth - TURN }), to('turn right', { azimuth: view.azimuth + TURN }),
    to('from above', { elevation: Math.min(90, view.elevation + TILT) }), to('from below', { elevation: Math.max(-90, view.elevation - TILT) }),
  ];
  if (modes) {
    links.push(to('previous mode', { color: 'basis', basis: Math.max(0, view.basis - 1) }));
    links.push(to('next mode', { color: 'basis', basis: Math.min(modes - 1, view.basis + 1) }));
  }
  box.replaceChildren(make('p', {}, 'This browser offers no WebGL 2; these are pictures by the service.'), image, make('p', {}, ...links.flatMap((link) => [link, ' · '])));
}
