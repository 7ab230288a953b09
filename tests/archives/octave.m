% Whether Octave reads the MATLAB files of an export as the WAVs of the same taps: by hand, as Octave is large.
%
%   tapline export ARCHIVE taps --out wav
%   tapline export ARCHIVE taps --format mat --out mat
%   octave-cli --eval "addpath('tests/archives'); octave('wav', 'mat')"
function octave(wav, mat)
  % The exports list the same taps in the same order.
  lists = cellfun(@(folder) strsplit(strtrim(fileread(fullfile(folder, 'taps.csv'))), "\n"), {wav, mat}, 'UniformOutput', false);
  scan = fileread(fullfile(wav, 'scan.toml'));
  number = @(key) str2double(regexp(scan, [key ' = ([-+.0-9e]+)'], 'tokens', 'once'){1});
  scales = [number('force_full_scale_n'), number('sound_full_scale_v')];
  files = struct();
  for k = 2:numel(lists{1})
    cells = cellfun(@(list) strsplit(list{k}, ',', 'CollapseDelimiters', false), lists, 'UniformOutput', false);
    samples = audioread(fullfile(wav, cells{1}{1})) .* scales;
    name = cells{2}{1};
    key = regexprep(name, '[^A-Za-z0-9]', '_');
    if ~isfield(files, key)
      files.(key) = load(fullfile(mat, name));
    end
    taps = files.(key);
    column = str2double(cells{2}{15});
    got = double([taps.force(:, column), taps.sound(:, column)]);
    worst = max(max(abs(got - samples) ./ max(abs(samples))));
    assert(worst < 1e-6, 'tap %d differs by %g', k - 1, worst);
    assert(taps.location(column) == str2double(cells{1}{6}));
  end
  assert(taps.sample_rate_hz == number('sample_rate_hz'));
  printf('%d taps are the same\n', numel(lists{1}) - 1);
end
