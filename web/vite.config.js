import { createHash } from 'node:crypto';
import { readFileSync } from 'node:fs';

const digest = (text) => `'sha256-${createHash('sha256').update(text).digest('base64')}'`;
const escaped = (text) => text.replaceAll('&', '&amp;').replaceAll('<', '&lt;');

/** Makes the page one file: script, style, icon and licences within it, and a policy that allows these and nothing else. */
const oneFile = {
  name: 'one-file',
  enforce: 'post',
  generateBundle(_options, bundle) {
    const html = bundle['index.html'];
    const take = (ending) => {
      const name = Object.keys(bundle).find((n) => n.endsWith(ending)), file = bundle[name];
      delete bundle[name];
      return (file.code ?? String(file.source)).trim();
    };
    const script = take('.js').replaceAll('</script', '<\\/script'), style = take('.css');
    const policy =
      `default-src 'none'; script-src ${digest(script)}; style-src ${digest(style)}; img-src data: blob:; ` +
      `connect-src 'self' ws:; base-uri 'none'; form-action 'none'`;
    const icon = readFileSync(new URL('icon.svg', import.meta.url), 'utf8').trim();
    const within = [
      [/\s*<script [^>]*src=[^>]*><\/script>/, () => ''],
      [/\s*<link rel="stylesheet"[^>]*>/, () => ''],
      ['</head>', () => `<style>${style}</style>\n  </head>`],
      ['</body>', () => `<script type="module">${script}</script>\n  </body>`],
      ['POLICY', () => policy],
      ['ICON', () => `data:image/svg+xml,${encodeURIComponent(icon)}`],
      ['LICENCES', () => escaped(readFileSync(new URL('licences.txt', import.meta.url), 'utf8').trim())],
    ];
    html.source = html.source.replace(/\n\s+/g, '\n');
    for (const [place, text] of within) {
      if (html.source.search(place) < 0) this.error(`index.html has no ${place}`);
      html.source = html.source.replace(place, text);
    }
    const left = Object.keys(bundle).filter((name) => name !== 'index.html');
    if (left.length > 0) this.error(`not in the one file: ${left.join(', ')}`);
  },
};

export default {
  build: { outDir: 'dist', assetsInlineLimit: 0, modulePreload: false, target: 'es2022' },
  plugins: [oneFile],
};
