export default {
  build: { outDir: 'dist', assetsInlineLimit: 0, modulePreload: false, target: 'es2022' },
};
