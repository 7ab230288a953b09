// The page of a running line: it shows each status that the line sends, and shows when no more come.
'use strict';
(() => {
  // The line sends its status every second.
  const SILENT_AFTER_MS = 3000;
  const RECONNECT_MS = 2000;
  // A verdict stays on its station's light for so long, unless a casing comes; after that it is only in the list.
  const LIT_MS = 10 * 60 * 1000;
  const ALARM_NEW_MS = 10 * 60 * 1000;
  // More of them would push the stations off the screen; the list below has all.
  const BANNER_ALARMS = 5;
  const STATES = {
    pass: 'PASS', 're-inspect': 'RE-INSPECT', reject: 'REJECT',
    scanning: 'SCANNING', judging: 'JUDGING', idle: 'NO CASING', unknown: 'NO SIGNAL',
    stopped: 'STOPPED', refused: 'REFUSED', held: 'WAITING', done: 'DONE',
  };
  const VERDICTS_SHOWN = 16;
  // How a verdict was reached, for the report; people at the station need not act on it.
  const FOR_THE_REPORT = ['damage', 'suspect', 'extrapolated', 'self_reference', 'velocity_unknown'];
  const SVG = 'http://www.w3.org/2000/svg';
  const byId = (id) => document.getElementById(id);
  const cards = new Map();
  let status = null;
  let receivedAt = 0;
  let isLive = false;
  let lostSince = new Date();
  let lostWhy = 'No connection to the line';
  let toldNs = null;

  function make(name, attributes = {}, ...children) {
    const node = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    node.append(...children);
    return node;
  }
  function draw(name, attributes = {}, text) {
    const node = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    if (text !== undefined) node.textContent = text;
    return node;
  }
  // What has not changed is left as it is, so that screen readers and the focus stay where they are.
  function put(node, text) {
    if (node.textContent !== text) node.textContent = text;
  }
  function set(node, name, value) {
    if (node.getAttribute(name) !== value) node.setAttribute(name, value);
  }
  function keyed(node, key, build) {
    if (node.dataset.key === key) return;
    node.dataset.key = key;
    node.replaceChildren(...build());
  }

  // A shape with a sign in it for each state, so that nothing depends on colour only.
  function sign(state) {
    const svg = draw('svg', { viewBox: '0 0 48 48', 'aria-hidden': 'true' });
    const shape = {
      pass: ['circle', { cx: 24, cy: 24, r: 21, fill: '#00674b' }],
      're-inspect': ['polygon', { points: '24,3 46,44 2,44', fill: '#f0b400' }],
      reject: ['polygon', { points: '15,3 33,3 45,15 45,33 33,45 15,45 3,33 3,15', fill: '#b3001b' }],
    }[state];
    const mark = {
      pass: ['M13 25 L21 33 L36 16', '#fff'],
      're-inspect': ['M24 16 L24 30 M24 35 L24 39', '#000'],
      reject: ['M15 15 L33 33 M33 15 L15 33', '#fff'],
    }[state];
    if (shape) {
      svg.append(draw(shape[0], { ...shape[1], stroke: mark[1], 'stroke-width': 2 }));
      svg.append(draw('path', { d: mark[0], stroke: mark[1], 'stroke-width': 6, fill: 'none' }));
    } else if (['unknown', 'stopped', 'refused', 'held'].includes(state)) {
      svg.append(draw('rect', { x: 4, y: 4, width: 40, height: 40, fill: 'none', stroke: 'currentColor', 'stroke-width': 3, 'stroke-dasharray': '6 4' }));
      svg.append(draw('text', { x: 24, y: 35, 'text-anchor': 'middle', 'font-size': 32, 'font-weight': 800, fill: 'currentColor' }, state === 'unknown' ? '?' : '!'));
    } else if (state === 'done') {
      svg.append(draw('rect', { x: 5, y: 5, width: 38, height: 38, fill: 'none', stroke: 'currentColor', 'stroke-width': 6 }));
    } else if (state === 'idle') {
      svg.append(draw('path', { d: 'M8 24 L40 24', stroke: 'currentColor', 'stroke-width': 6 }));
    } else {
      svg.append(draw('circle', { cx: 24, cy: 24, r: 19, fill: 'none', stroke: 'currentColor', 'stroke-width': 6, 'stroke-dasharray': '10 5' }));
    }
    return svg;
  }

  const kindOf = (verdict) => verdict.toLowerCase();
  // With the day if that is not the line's today.
  function moment(ns) {
    const [then, now] = [new Date(ns / 1e6), new Date(status.at_ns / 1e6)];
    const time = then.toLocaleTimeString([], { hour: '2-digit', minute: '2-digit', second: '2-digit' });
    return then.toDateString() === now.toDateString() ? time : `${then.toLocaleDateString()} ${time}`;
  }
  // By the clock of the line; the browser's clock may differ.
  const ageMs = (ns) => status.at_ns / 1e6 + (performance.now() - receivedAt) - ns / 1e6;
  function ago(ns) {
    const s = Math.max(0, Math.round(ageMs(ns) / 1000));
    if (s < 60) return `${s} s ago`;
    if (s < 3600) return `${Math.round(s / 60)} min ago`;
    return `at ${moment(ns)}`;
  }
  // A clock that was set back makes a verdict neither new nor old.
  const isRecent = (ns, withinMs) => Math.abs(ageMs(ns)) < withinMs;
  const degrees = (deg) => `${Math.round(deg)}°`;
  // The reasons for which someone should look, in words.
  const meanings = JSON.parse(document.body.dataset.reasons);
  function reasonsOf(shoulder) {
    // Where taps were refused, why comes first, and what merely follows from that is left out.
    const refused = shoulder.refused_taps;
    const follows = refused ? refused.covers.split('|') : [];
    const names = shoulder.reasons.split('|').filter((name) => name && !FOR_THE_REPORT.includes(name) && !follows.includes(name));
    const flags = Object.entries(shoulder.flags ?? {}).map(([flag, part]) => `${flag.replaceAll('_', ' ')} on ${Math.round(100 * part)} % of the taps`);
    const words = names.map((name) => (name === 'flagged' && flags.length ? `${flags.join(', ')}.` : meanings[name] ?? name));
    return [...(refused ? [`${refused.text}.`] : []), ...words].join(' ');
  }
  function placeOf(arc) {
    if (arc.start_deg === null || arc.end_deg === null) return `locations ${arc.first_location} to ${arc.last_location}`;
    const [from, to] = ends(arc);
    // The outermost locations, as in the report; the arc is drawn half a step farther.
    if (to - from >= 359.9) return 'all round';
    return arc.first_location === arc.last_location ? `at ${degrees(arc.start_deg)}` : `${degrees(arc.start_deg)} to ${degrees(arc.end_deg)}`;
  }
  // Halfway to the neighbours of the first and the last location.
  function ends(arc) {
    const span = (((arc.end_deg - arc.start_deg) % 360) + 360) % 360;
    const half = Math.max(0, ((arc.extent_deg ?? span) - span) / 2);
    return [arc.start_deg - half, arc.start_deg + span + half];
  }

  // Angles are clockwise from the top, as on the casing's report.
  const CENTRE = 130;
  function at(radius, deg) {
    const angle = (deg * Math.PI) / 180;
    return `${(CENTRE + radius * Math.sin(angle)).toFixed(2)} ${(CENTRE - radius * Math.cos(angle)).toFixed(2)}`;
  }
  function sweep(radius, from, to) {
    const end = Math.min(to, from + 359.9);
    const large = end - from > 180 ? 1 : 0;
    return `M${at(radius, from)} A${radius} ${radius} 0 ${large} 1 ${at(radius, end)}`;
  }
  function sector(low, high, from, to) {
    const end = Math.min(to, from + 359.9);
    const large = end - from > 180 ? 1 : 0;
    return `M${at(high, from)} A${high} ${high} 0 ${large} 1 ${at(high, end)} L${at(low, end)} A${low} ${low} 0 ${large} 0 ${at(low, from)} Z`;
  }
  // Where damage is along a row of places without angles. The row may be a ring, with damage across its seam.
  function strips(arc, count) {
    const [first, last] = [arc.first_location, arc.last_location];
    const runs = first <= last ? [[first, last]] : [[first, count - 1], [0, last]];
    const x = (place) => (5 + (250 / count) * place).toFixed(2);
    return runs.filter(([, to]) => to < count).map(([from, to]) => draw('path', { class: 'arc', d: `M${x(from)} 74 H${x(to + 1)}` }));
  }
  // The range of each location: halfway to its neighbours, but at most half the usual step, so that what is not scanned
  // stays empty.
  function sectors(angles) {
    const order = angles.map((deg, place) => [deg, place]).sort((a, b) => a[0] - b[0]);
    const count = order.length;
    const step = (a, b) => (((order[b][0] - order[a][0]) % 360) + 360) % 360;
    const steps = order.slice(1).map((_, k) => step(k, k + 1)).sort((a, b) => a - b);
    const usual = steps.length ? steps[Math.floor(steps.length / 2)] || 360 : 360;
    const half = (of) => 0.5 * (of > 0 && of < usual ? of : usual);
    const found = new Array(count);
    order.forEach(([deg, place], k) => {
      found[place] = [deg - half(step((k + count - 1) % count, k)), deg + half(step(k, (k + 1) % count))];
    });
    return found;
  }

  function ring(shoulder) {
    const count = shoulder.locations.length;
    const isRing = shoulder.angles_deg.length === count && count > 0;
    const svg = draw('svg', { viewBox: isRing ? '-26 10 312 240' : '0 0 260 90', role: 'img' });
    const places = draw('g', {});
    if (isRing) {
      sectors(shoulder.angles_deg).forEach(([from, to]) => places.append(draw('path', { class: 'place', d: sector(62, 92, from, to) })));
      svg.append(draw('path', { class: 'zero', d: `M${at(94, 0)} L${at(103, -4)} L${at(103, 4)} Z` }));
    } else {
      const width = 250 / Math.max(count, 1);
      for (let k = 0; k < count; k += 1) {
        places.append(draw('rect', { class: 'place', x: (5 + k * width).toFixed(2), y: 40, width: width.toFixed(2), height: 26 }));
      }
    }
    const arcs = draw('g', {});
    const mid = draw('text', { class: 'mid', x: CENTRE, y: isRing ? CENTRE + 11 : 26 });
    const lamp = draw('g', {});
    svg.append(places, arcs, lamp, mid);
    const caption = make('figcaption');
    return { figure: make('figure', {}, svg, caption), svg, places, arcs, lamp, mid, caption, isRing };
  }

  const CLASS = (character) => ({ 0: 'place', 9: 'place all', r: 'place refused' })[character] ?? 'place part';

  function showRing(of, shoulder, judged, isMany) {
    [...shoulder.locations].forEach((character, k) => set(of.places.children[k], 'class', CLASS(character)));
    const done = [...shoulder.locations].filter((character) => character === '9' || character === 'r').length;
    const refused = [...shoulder.locations].filter((character) => character === 'r').length;
    const count = shoulder.locations.length;
    const name = isMany ? `${shoulder.tyre}/${shoulder.shoulder}` : `Shoulder ${shoulder.shoulder}`;
    const arcs = judged ? judged.arcs : [];
    const percent = `${shoulder.planned ? Math.floor((100 * shoulder.settled) / shoulder.planned) : 0} %`;
    put(of.mid, judged ? judged.verdict : isLive ? percent : '?');
    set(of.mid, 'class', judged ? 'mid mid-verdict' : 'mid');
    set(of.mid, 'y', String(of.isRing ? CENTRE + (judged ? 33 : 11) : 26));
    keyed(of.lamp, judged && of.isRing ? judged.verdict : '', () => {
      if (!judged || !of.isRing) return [];
      const lamp = sign(kindOf(judged.verdict));
      for (const [name, value] of Object.entries({ x: CENTRE - 27, y: CENTRE - 42, width: 54, height: 54 })) lamp.setAttribute(name, value);
      return [lamp];
    });
    const where = arcs.map(placeOf).join(', ');
    const why = judged ? reasonsOf(judged) : '';
    put(of.caption, [name, [where, why].filter(Boolean).join('. ')].filter(Boolean).join(': '));
    const refusals = refused ? `, ${refused} with a refused tap` : '';
    const state = judged ? `${judged.verdict}${where ? `, damage at ${where}` : ''}` : `${done} of ${count} locations tapped`;
    set(of.svg, 'aria-label', `${name}: ${state}${refusals}`);
    keyed(of.arcs, JSON.stringify(arcs), () => arcs.flatMap((arc) => {
      if (!of.isRing) return strips(arc, count);
      if (arc.start_deg === null) return [];
      const [from, to] = ends(arc);
      const peak = arc.peak_deg ?? (from + to) / 2;
      // Text is wider than it is high.
      const [x, y] = at(112 + 20 * Math.abs(Math.sin((peak * Math.PI) / 180)), peak).split(' ');
      return [
        draw('path', { class: 'arc', d: sweep(99, from, to), 'data-from': from.toFixed(1), 'data-to': to.toFixed(1), 'data-peak': peak.toFixed(1) }),
        draw('text', { class: 'deg', x, y: Number(y) + 6 }, degrees(peak)),
      ];
    }));
  }

  function card(number) {
    const parts = {
      article: make('article', { class: 'station', id: `station-${number}`, 'aria-labelledby': `station-${number}-name` }),
      sign: make('span', {}), word: make('span', { class: 'word' }), casing: make('p', { class: 'casing' }),
      note: make('p', { class: 'note' }), rings: make('div', { class: 'rings' }), facts: make('dl', { class: 'facts' }),
      waits: make('p', { class: 'waits' }), before: make('p', { class: 'before' }), due: make('div', { class: 'due' }), drawn: [],
    };
    parts.article.append(
      make('h2', { id: `station-${number}-name` }, `Station ${number}`),
      make('div', { class: 'light' }, make('p', { class: 'sign' }, parts.sign, parts.word), parts.casing, parts.note),
      parts.rings, parts.facts, parts.waits, parts.before, parts.due,
    );
    return parts;
  }

  // What a station's light shows: the casing that is there, or the verdict on the last one.
  function stateOf(station) {
    if (!isLive) return { state: 'unknown' };
    const { casing, last } = station;
    // What is at a station whose rig or device is away is not known.
    if (station.fault) return { state: 'unknown', casing };
    if (station.stopped) return { state: 'stopped', casing };
    if (casing) {
      const isTapped = casing.planned > 0 && casing.archived + casing.refused >= casing.planned;
      return { state: isTapped ? 'judging' : 'scanning', casing };
    }
    // Held, the line does not know whether another casing has come.
    if (status.held_by) return { state: 'held' };
    if (station.refused && isRecent(station.refused.at_ns, LIT_MS)) return { state: 'refused' };
    const verdict = verdictOf(station);
    const isCurrent = verdict && last && !station.is_removed && isRecent(verdict.at_ns, LIT_MS);
    if (isCurrent) return { state: kindOf(verdict.verdict), casing: last, verdict };
    // A line that was started anew, or has shown the verdict for long enough, still knows that the casing is on the rig.
    const [, name, end] = station.waits_for?.match(/^another casing on the rig .*: (.+) (is done|was refused)$/) ?? [];
    return !name ? { state: 'idle' } : end === 'is done' ? { state: 'done', name } : { state: 'refused' };
  }
  function verdictOf(station) {
    return status.verdicts.find((verdict) => verdict.station === station.number && verdict.casing === station.last?.name);
  }

  function showStation(station) {
    if (!cards.has(station.number)) cards.set(station.number, card(station.number));
    const parts = cards.get(station.number);
    const { state, casing, verdict, name } = stateOf(station);
    const earlier = status.verdicts.find((of) => of.station === station.number && of.casing === name);
    set(parts.article, 'data-state', state);
    set(parts.article, 'data-casing', casing?.name ?? name ?? '');
    keyed(parts.sign, state, () => [sign(state)]);
    put(parts.word, STATES[state]);
    put(parts.casing, casing?.name ?? name ?? '\u00a0');
    const settled = casing ? casing.archived + casing.refused : 0;
    put(parts.note, verdict ? ago(verdict.at_ns) : earlier ? `${earlier.verdict}, at ${moment(earlier.at_ns)}` : casing ? `${settled} of ${casing.planned} taps` : '\u00a0');

    // Without a new status the last picture stays, greyed.
    const shown = casing ?? (isLive ? null : station.casing ?? station.last);
    const shoulders = shown ? shown.shoulders : [];
    const layout = JSON.stringify(shoulders.map((of) => [of.tyre, of.shoulder, of.locations.length, of.angles_deg]));
    keyed(parts.rings, layout, () => {
      parts.drawn = shoulders.map(ring);
      return parts.drawn.map((of) => of.figure);
    });
    const isMany = new Set(shoulders.map((of) => of.tyre)).size > 1;
    shoulders.forEach((shoulder, k) => {
      const judged = verdict?.shoulders.find((of) => of.tyre === shoulder.tyre && of.shoulder === shoulder.shoulder);
      showRing(parts.drawn[k], shoulder, judged, isMany);
    });

    const { tally } = station;
    const open = station.casing ?? { refused: 0, retaken: 0 };
    const facts = [
      [tally.since_ns ? `Since ${moment(tally.since_ns)}: PASS` : 'So far: PASS', tally.verdicts.pass], ['RE-INSPECT', tally.verdicts.re_inspect], ['REJECT', tally.verdicts.reject],
      ['taps refused', tally.refused + open.refused], ['missing', tally.missing], ['taken again', tally.retaken + open.retaken],
    ].filter(([, value], k) => k < 3 || value > 0);
    keyed(parts.facts, JSON.stringify(facts), () => facts.map(([name, value]) => make('div', {}, make('dt', {}, name), make('dd', {}, String(value)))));
    const waits = !isLive ? '' : state === 'refused' ? (station.refused?.text ?? station.waits_for)
      : station.waits_for && !station.waits_for.startsWith('nothing') ? `Waits for ${station.waits_for}` : '';
    put(parts.waits, waits);
    const before = isLive && !verdict && !earlier ? verdictOf(station) : undefined;
    keyed(parts.before, before ? before.casing + before.at_ns : '', () => (before ? ['Previous: ', sign(kindOf(before.verdict)), ` ${before.casing} ${before.verdict}, at ${moment(before.at_ns)}`] : []));
    const daysLeft = (Date.parse(station.calibration_ends) - status.at_ns / 1e6) / 86400e3 + 1;
    const due = station.is_calibration_out_of_date
      ? [`▲ The calibration of ${station.calibrated_on ?? 'this station'} is not known to be valid on the day of the last casing`]
      : daysLeft < 15 ? [`▲ Calibrate this station: its calibration ends on ${station.calibration_ends}`] : [];
    const signs = station.signs.map((of) => `▲ Check the rig: ${of.name} on ${of.count} casings, ${of.first} to ${of.last}${of.detail ? `: ${of.detail}` : ''}`);
    keyed(parts.due, JSON.stringify([due, signs]), () => [...due, ...signs].map((text) => make('p', {}, text)));
    return parts.article;
  }

  function shouldersOf(verdict) {
    const isMany = new Set(verdict.shoulders.map((of) => of.tyre)).size > 1;
    return verdict.shoulders.map((of) => {
      const name = isMany ? `${of.tyre}/${of.shoulder}` : String(of.shoulder);
      const why = [of.arcs.map(placeOf).join(', '), reasonsOf(of)].filter(Boolean).join('. ');
      return make('p', {}, `${name}: ${of.verdict}${why ? `, ${why}` : ''}`);
    });
  }
  function reportsOf(verdict) {
    const tyres = [...new Set(verdict.shoulders.map((of) => of.tyre))];
    return tyres.slice(0, 4).map((tyre, k) => {
      const query = new URLSearchParams({ file: verdict.file, tyre: String(k) });
      const name = tyres.length > 1 ? tyre : 'report';
      return make('p', {}, make('a', { href: `/report?${query}`, target: '_blank', rel: 'noopener', 'aria-label': `Report of ${tyre}` }, name));
    });
  }
  // Of a casing that was scanned before on that day, with the number of its scan, which follows its name in that of the file.
  function nameOf(verdict) {
    const bytes = [...new TextEncoder().encode(verdict.casing)];
    const plain = (byte) => /[A-Za-z0-9._-]/.test(String.fromCharCode(byte)) && byte < 128;
    const name = bytes.map((byte) => (plain(byte) ? String.fromCharCode(byte) : `%${byte.toString(16).toUpperCase().padStart(2, '0')}`)).join('');
    const stem = verdict.file.split('/').pop().replace(/\.h5$/, '');
    const [, again] = stem.startsWith(name) ? stem.slice(name.length).match(/^\.(\d+)$/) ?? [] : [];
    return again ? `${verdict.casing} (scan ${again})` : verdict.casing;
  }
  function row(verdict) {
    const kind = kindOf(verdict.verdict);
    const cell = (label, name, ...children) => make('td', { 'data-label': label, class: name }, ...children);
    return make('tr', { 'data-casing': verdict.casing, 'data-verdict': verdict.verdict },
      cell('Time', 'time', moment(verdict.at_ns)), cell('Station', 'number', String(verdict.station)), cell('Casing', 'serial', nameOf(verdict)),
      cell('Verdict', 'kind', make('span', { class: 'verdict' }, sign(kind), verdict.verdict)),
      cell('Shoulders', 'shoulders', ...shouldersOf(verdict)), cell('Report', 'report', ...reportsOf(verdict)));
  }

  // The alarms that are not over.
  const lasting = () => status.alarms.filter(({ text }) => !text.startsWith('over: '));

  function showBanner() {
    const lines = [];
    if (!isLive) {
      lines.push(['lost', `✖ ${lostWhy} since ${lostSince.toLocaleTimeString()}. No verdict is known; everything below is old.`]);
    } else {
      status.troubles.forEach((trouble) => lines.push(['trouble', `▲ ${trouble}`]));
      const recent = lasting().filter((alarm) => isRecent(alarm.at_ns, ALARM_NEW_MS));
      recent.slice(0, BANNER_ALARMS).forEach((alarm) => lines.push(['alarm', `▲ Alarm, ${moment(alarm.at_ns)}: ${alarm.text}`]));
      if (recent.length > BANNER_ALARMS) lines.push(['alarm', `and ${recent.length - BANNER_ALARMS} more`]);
    }
    keyed(byId('banner'), JSON.stringify(lines), () => lines.map(([kind, text]) => make('p', { class: kind }, text)));
  }

  function showAlarms() {
    const { alarms } = status;
    byId('alarms').hidden = alarms.length === 0;
    const count = lasting().length;
    byId('alarm-count').hidden = count === 0;
    put(byId('alarm-count'), `▲ ${count} ${count === 1 ? 'alarm' : 'alarms'}`);
    const items = alarms.map((alarm) => [`${new Date(alarm.at_ns / 1e6).toLocaleString()}: ${alarm.text}`, isRecent(alarm.at_ns, ALARM_NEW_MS)]);
    keyed(byId('alarm-list'), JSON.stringify(items), () => items.map(([text, isNew]) => make('li', { class: isNew ? 'new' : '' }, `▲ ${text}`)));
  }

  function showNumbers() {
    const taps = status.stations.reduce((sum, { tally, casing }) => [
      sum[0] + tally.archived + (casing?.archived ?? 0), sum[1] + tally.refused + (casing?.refused ?? 0), sum[2] + tally.missing,
    ], [0, 0, 0]);
    const numbers = [
      ['taps/s', status.taps_per_s.toFixed(1)], ['casings judged', status.closed_count], ['taps archived', taps[0]],
      ['taps refused', taps[1]], ['taps missing', taps[2]], ['casings refused', status.refused_count],
    ];
    const shown = numbers.filter(([, value], k) => k < 5 || value > 0);
    keyed(byId('numbers'), JSON.stringify(shown), () => shown.map(([name, value]) => make('div', {}, make('dt', {}, name), make('dd', {}, String(value)))));
  }

  // Verdicts since the page was opened are read out, the oldest first.
  function announce() {
    const fresh = toldNs === null ? [] : status.verdicts.filter((verdict) => verdict.at_ns > toldNs).reverse();
    toldNs = Math.max(toldNs ?? 0, ...status.verdicts.map((verdict) => verdict.at_ns));
    for (const verdict of fresh) {
      const damage = verdict.shoulders.filter((of) => of.arcs.length).map((of) => `shoulder ${of.shoulder}: damage at ${of.arcs.map(placeOf).join(', ')}`);
      byId('news').append(make('p', {}, [`Station ${verdict.station}, casing ${verdict.casing}: ${verdict.verdict}`, ...damage].join('. ')));
    }
    while (byId('news').children.length > 8) byId('news').firstChild.remove();
  }

  function show() {
    document.body.dataset.link = isLive ? 'live' : 'lost';
    put(byId('link-mark'), isLive ? '●' : '✖');
    put(byId('link-text'), isLive ? 'live' : 'no signal');
    showBanner();
    if (!status) return;
    const name = byId('title').dataset.place || (status.out.split('/').filter(Boolean).pop() ?? 'Line');
    put(byId('title'), name);
    document.title = isLive ? name : `No signal: ${name}`;
    showNumbers();
    showAlarms();
    const articles = status.stations.map(showStation);
    const box = byId('stations');
    if (articles.length !== box.children.length || articles.some((article, k) => article !== box.children[k])) box.replaceChildren(...articles);
    put(byId('no-verdicts'), 'None in this folder yet.');
    byId('no-verdicts').hidden = status.verdicts.length > 0;
    put(byId('verdicts-title'), isLive ? 'Last verdicts' : 'Last verdicts before the signal was lost');
    const verdicts = status.verdicts.slice(0, VERDICTS_SHOWN);
    keyed(byId('verdict-list'), JSON.stringify(verdicts.map((verdict) => [verdict.casing, verdict.at_ns])), () => verdicts.map(row));
  }

  function lose(why) {
    if (isLive) {
      lostSince = new Date();
      isLive = false;
    }
    lostWhy = why;
    show();
  }

  function connect() {
    const source = new EventSource('/events');
    source.onmessage = (message) => {
      status = JSON.parse(message.data);
      receivedAt = performance.now();
      isLive = true;
      announce();
      show();
    };
    source.onerror = async () => {
      lose('No connection to the line');
      // The browser reconnects by itself, unless it was refused.
      if (source.readyState !== EventSource.CLOSED) return;
      const answer = await fetch('/healthz').catch(() => null);
      if (answer?.status === 401) {
        location.assign('/login');
        return;
      }
      setTimeout(connect, RECONNECT_MS);
    };
  }

  setInterval(() => {
    if (isLive && performance.now() - receivedAt > SILENT_AFTER_MS) lose('Nothing from the line');
    else if (status) show();
  }, 1000);
  setTimeout(() => { if (!status) show(); }, SILENT_AFTER_MS);
  connect();
})();
