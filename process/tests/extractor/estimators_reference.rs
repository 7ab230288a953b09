//! Cases of the estimators, with the values of numpy and scipy; written by `scipy_estimators.py`.

use tapline_wire::Discriminator;

use crate::signal::Case;

#[rustfmt::skip]
pub(crate) const CASES: &[(Case, &str, [Option<f64>; Discriminator::COUNT])] = &[
    (Case { name: "f_max = 'raw'", seed: 1, rate: 40960.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "f_max = 'raw'", [
        Some(30.975156223097656), // f_max
        Some(0.0010136623915306534), // tau
        Some(0.0006042856463348058), // a_1
        Some(0.0028118150266618755), // a_2
        Some(0.5028569482385515), // pr
        Some(5.6891486353840354e-05), // p_f
        Some(0.004888755725512045), // e_f
        Some(654.1243935933127), // centroid
    ]),
    (Case { name: "f_max = 'polynomial'", seed: 1, rate: 40960.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "f_max = 'polynomial'", [
        Some(31.014619629277867), // f_max
        Some(0.001013519942636613), // tau
        Some(0.0006042515679469649), // a_1
        Some(0.0028118212751292388), // a_2
        Some(0.5028569482385515), // pr
        Some(5.6891486353840354e-05), // p_f
        Some(0.004888755725512045), // e_f
        Some(654.1243935933127), // centroid
    ]),
    (Case { name: "f_max = 'polynomial'\ntau = 'width_50'", seed: 12, rate: 40960.0, count: 4096, p: 400, is_i16: true, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 0.000152587890625, force_unit: 0.00677490234375, offset: 0.0, noise: 0.05, f_lo: 70.0, follow: false }, "f_max = 'polynomial'\ntau = 'width_50'", [
        Some(30.834271155759083), // f_max
        Some(0.0009473212452836291), // tau
        Some(0.0006036487964092953), // a_1
        Some(0.0033260185284139194), // a_2
        Some(0.49991368868090397), // pr
        Some(5.701096510281093e-05), // p_f
        Some(0.004868692076352987), // e_f
        Some(653.822246050982), // centroid
    ]),
    (Case { name: "f_max = 'polynomial'", seed: 1, rate: 5000.0, count: 1024, p: 100, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 101.3, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "f_max = 'polynomial'", [
        Some(31.007992441389426), // f_max
        Some(0.001119992761199218), // tau
        Some(0.0006490454071419704), // a_1
        Some(0.0027249647652647564), // a_2
        Some(0.4859221981247522), // pr
        Some(2.5928514810078878e-05), // p_f
        Some(0.002364279665080749), // e_f
        Some(635.8976731695748), // centroid
    ]),
    (Case { name: "tau = 'width_02'", seed: 1, rate: 40960.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "tau = 'width_02'", [
        Some(30.976362171822498), // f_max
        Some(0.0010653777466976848), // tau
        Some(0.0005977241190125818), // a_1
        Some(0.0028052547310248024), // a_2
        Some(0.5028569482385515), // pr
        Some(5.6891486353840354e-05), // p_f
        Some(0.004888755725512045), // e_f
        Some(654.1243935933127), // centroid
    ]),
    (Case { name: "tau = 'width_50'", seed: 1, rate: 40960.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "tau = 'width_50'", [
        Some(30.976362171822498), // f_max
        Some(0.0009347160344305071), // tau
        Some(0.0006082805005757004), // a_1
        Some(0.002815811112587921), // a_2
        Some(0.5028569482385515), // pr
        Some(5.6891486353840354e-05), // p_f
        Some(0.004888755725512045), // e_f
        Some(654.1243935933127), // centroid
    ]),
    (Case { name: "tau = 'impulse'", seed: 1, rate: 40960.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "tau = 'impulse'", [
        Some(30.976362171822498), // f_max
        Some(0.0009626775604092303), // tau
        Some(0.0006068715828561848), // a_1
        Some(0.0028144021948684054), // a_2
        Some(0.5028569482385515), // pr
        Some(5.6891486353840354e-05), // p_f
        Some(0.004888755725512045), // e_f
        Some(654.1243935933127), // centroid
    ]),
    (Case { name: "tau = 'impulse'", seed: 1, rate: 40960.0, count: 4096, p: 5, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 5.5, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "tau = 'impulse'", [
        Some(30.994163890977813), // f_max
        Some(0.0009622049879210842), // tau
        Some(0.0006065695386167528), // a_1
        Some(0.0028203993696184837), // a_2
        Some(0.5029271772844374), // pr
        Some(5.681617708563519e-05), // p_f
        Some(0.004888831818610259), // e_f
        Some(654.2403610208736), // centroid
    ]),
    (Case { name: "droop_time_constant_s = 0.01", seed: 1, rate: 40960.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "droop_time_constant_s = 0.01", [
        Some(31.943360660306585), // f_max
        Some(0.0010484698044515284), // tau
        Some(0.0005998157043707857), // a_1
        Some(0.002807547126800542), // a_2
        Some(0.5028569482385515), // pr
        Some(5.6891486353840354e-05), // p_f
        Some(0.004888755725512045), // e_f
        Some(654.1243935933127), // centroid
    ]),
    (Case { name: "droop_time_constant_s = 0.1\nf_max = 'polynomial'\ntau = 'impulse'", seed: 16, rate: 40960.0, count: 4096, p: 400, is_i16: true, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 0.000152587890625, force_unit: 0.00677490234375, offset: 2.0, noise: 0.002, f_lo: 70.0, follow: false }, "droop_time_constant_s = 0.1\nf_max = 'polynomial'\ntau = 'impulse'", [
        Some(31.104983717833086), // f_max
        Some(0.000967623930925169), // tau
        Some(0.000606670786539744), // a_1
        Some(0.0028156603820645373), // a_2
        Some(0.502812778072285), // pr
        Some(5.6888645803810387e-05), // p_f
        Some(0.004888304570913424), // e_f
        Some(654.1690462959912), // centroid
    ]),
    (Case { name: "band_edges = 'fractional'", seed: 1, rate: 41000.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "band_edges = 'fractional'", [
        Some(30.976251773267098), // f_max
        Some(0.001013648888979462), // tau
        Some(0.0006042841407306482), // a_1
        Some(0.0028122324370817233), // a_2
        Some(0.5040549001780203), // pr
        Some(5.7069075280098085e-05), // p_f
        Some(0.004883872014814989), // e_f
        Some(656.6689248811286), // centroid
    ]),
    (Case { name: "record_s = 0.05", seed: 18, rate: 40960.0, count: 4096, p: 400, is_i16: true, has_force: false, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 0.000152587890625, force_unit: 0.00677490234375, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "record_s = 0.05", [
        None, // f_max
        None, // tau
        None, // a_1
        Some(0.0032814480364322662), // a_2
        Some(0.504733181196535), // pr
        Some(0.00011324241823426338), // p_f
        Some(0.009761371442157081), // e_f
        Some(657.0150551382334), // centroid
    ]),
    (Case { name: "record_s = 0.1\nband_edges = 'fractional'", seed: 17, rate: 41000.0, count: 16384, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.02, f_lo: 70.0, follow: false }, "record_s = 0.1\nband_edges = 'fractional'", [
        Some(30.919286773824382), // f_max
        Some(0.0010155099685515093), // tau
        Some(0.0006065470794836729), // a_1
        Some(0.0029611499400272277), // a_2
        Some(0.5064195225058912), // pr
        Some(5.6555071475330086e-05), // p_f
        Some(0.004916064166938875), // e_f
        Some(659.7705913958409), // centroid
    ]),
    (Case { name: "band_edges = 'fractional'", seed: 1, rate: 40960.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 0.0, follow: false }, "band_edges = 'fractional'", [
        Some(30.976362171822498), // f_max
        Some(0.0010136580384836477), // tau
        Some(0.0006042846057446658), // a_1
        Some(0.0028118152177568864), // a_2
        Some(0.476943727709004), // pr
        Some(5.6891486353840354e-05), // p_f
        Some(0.0048791489098964635), // e_f
        Some(623.3751489996673), // centroid
    ]),
    (Case { name: "subtract = 'noise'", seed: 1, rate: 40960.0, count: 16384, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.05, f_lo: 70.0, follow: false }, "subtract = 'noise'", [
        Some(31.527279975323253), // f_max
        Some(0.0010039303503741844), // tau
        Some(0.0005945227182352402), // a_1
        Some(0.0035036273814761697), // a_2
        Some(0.505094464274192), // pr
        Some(1.464523721479175e-05), // p_f
        Some(0.0012276246492882992), // e_f
        Some(667.2752075990323), // centroid
    ]),
    (Case { name: "subtract = 'noise'\nrecord_s = 0.05", seed: 22, rate: 40960.0, count: 16384, p: 400, is_i16: true, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 0.000152587890625, force_unit: 0.00677490234375, offset: 0.0, noise: 0.03, f_lo: 70.0, follow: false }, "subtract = 'noise'\nrecord_s = 0.05", [
        Some(31.265120442708334), // f_max
        Some(0.001017353582269186), // tau
        Some(0.0006018481654034287), // a_1
        Some(0.0026332214553778594), // a_2
        Some(0.5050510706325938), // pr
        Some(0.00011312738945193613), // p_f
        Some(0.00976414925845025), // e_f
        Some(659.2624253939446), // centroid
    ]),
    (Case { name: "subtract = 'hum'", seed: 23, rate: 40960.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.2, noise: 0.002, f_lo: 70.0, follow: false }, "subtract = 'hum'", [
        Some(30.990249759536525), // f_max
        Some(0.0010130750317068598), // tau
        Some(0.000604314804488856), // a_1
        Some(0.002813123667521933), // a_2
        Some(0.5027908335322022), // pr
        Some(5.689848548828988e-05), // p_f
        Some(0.004886790186916464), // e_f
        Some(654.1512259719251), // centroid
    ]),
    (Case { name: "subtract = 'both'\nmains_hz = 60.0\nrecord_s = 0.05\nband_edges = 'fractional'", seed: 24, rate: 40960.0, count: 16384, p: 400, is_i16: true, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 0.000152587890625, force_unit: 0.00677490234375, offset: 0.0, noise: 0.02, f_lo: 70.0, follow: false }, "subtract = 'both'\nmains_hz = 60.0\nrecord_s = 0.05\nband_edges = 'fractional'", [
        Some(30.7987060546875), // f_max
        Some(0.0010148032005137086), // tau
        Some(0.0006044751559633775), // a_1
        Some(0.0026338684598366966), // a_2
        Some(0.5041637511097014), // pr
        Some(0.00011259210086861593), // p_f
        Some(0.009751590143172121), // e_f
        Some(657.1560440943423), // centroid
    ]),
    (Case { name: "subtract = 'hum'", seed: 1, rate: 40960.0, count: 4096, p: 100, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 101.0, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, "subtract = 'hum'", [
        Some(31.005857920165486), // f_max
        Some(0.0010130148991339834), // tau
        Some(0.0006045006500888499), // a_1
        Some(0.0028175829127124368), // a_2
        Some(0.5033038984771727), // pr
        Some(5.680869542915429e-05), // p_f
        Some(0.004892253035608807), // e_f
        Some(655.1143104057525), // centroid
    ]),
];
