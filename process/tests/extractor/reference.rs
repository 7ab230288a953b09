//! Cases with the values of numpy and scipy; written by `scipy_reference.py`.

use tapline_wire::Discriminator;

use crate::signal::Case;

#[rustfmt::skip]
pub(crate) const CASES: &[(Case, [Option<f64>; Discriminator::COUNT])] = &[
    (Case { name: "f32 as the rig records it", seed: 1, rate: 40960.0, count: 16384, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        Some(30.976362171822498), // f_max
        Some(0.0010136580384836477), // tau
        Some(0.0006041437013972598), // a_1
        Some(0.00296505434694269), // a_2
        Some(0.5037256790118779), // pr
        Some(1.4217084042799288e-05), // p_f
        Some(0.001220325205494844), // e_f
        Some(656.117801523833), // centroid
    ]),
    (Case { name: "i16 as the rig records it", seed: 2, rate: 41000.0, count: 16384, p: 400, is_i16: true, has_force: true, sound_first: false, distance: 0.3, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 0.000152587890625, force_unit: 0.00677490234375, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        Some(31.02956911412681), // f_max
        Some(0.0010131833272881482), // tau
        Some(0.0006041204354730236), // a_1
        Some(0.0029638758783473163), // a_2
        Some(0.5037403715546969), // pr
        Some(1.4239298437094417e-05), // p_f
        Some(0.0012213440873332692), // e_f
        Some(656.4303966434048), // centroid
    ]),
    (Case { name: "i16, odd count, fast", seed: 3, rate: 625000.0, count: 3127, p: 500, is_i16: true, has_force: true, sound_first: false, distance: 0.0, onset: 501.8, tau: 0.0003, f_max: 31.0, sound_unit: 0.001, force_unit: 0.01, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        Some(31.010250000000003), // f_max
        Some(0.00027597335855058614), // tau
        Some(0.00027863381857680804), // a_1
        Some(0.000994924152127377), // a_2
        Some(0.789560352019488), // pr
        Some(0.00026218149496005217), // p_f
        Some(0.09683072448014965), // e_f
        Some(913.6173286892819), // centroid
    ]),
    (Case { name: "f32, no force, edge on a bin", seed: 4, rate: 200000.0, count: 2000, p: 500, is_i16: false, has_force: false, sound_first: false, distance: 0.0, onset: 503.2, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        None, // f_max
        None, // tau
        None, // a_1
        Some(0.0019925880257852624), // a_2
        Some(0.5172854781228342), // pr
        Some(0.00025982197121248904), // p_f
        Some(0.045148298452100104), // e_f
        Some(662.3465388717729), // centroid
    ]),
    (Case { name: "i16, no force, odd count", seed: 5, rate: 40960.0, count: 4095, p: 101, is_i16: true, has_force: false, sound_first: false, distance: 0.0, onset: 150.5, tau: 0.0011, f_max: 31.0, sound_unit: 0.0001, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        None, // f_max
        None, // tau
        None, // a_1
        Some(0.0034671789550781255), // a_2
        Some(0.5024118781832323), // pr
        Some(5.687281675979786e-05), // p_f
        Some(0.004883920380071138), // e_f
        Some(654.1476902428005), // centroid
    ]),
    (Case { name: "f32 on a large offset, sound first", seed: 6, rate: 40960.0, count: 5008, p: 333, is_i16: false, has_force: true, sound_first: true, distance: 0.0, onset: 350.0, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 40.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        Some(31.024104621172768), // f_max
        Some(0.001012524685079319), // tau
        Some(0.0006039195903116716), // a_1
        Some(0.0028259942307568226), // a_2
        Some(0.5039653788406097), // pr
        Some(4.6218077973004325e-05), // p_f
        Some(0.003988840253170159), // e_f
        Some(657.3585797961383), // centroid
    ]),
    (Case { name: "band from 0 Hz", seed: 7, rate: 40960.0, count: 8192, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.3, noise: 0.002, f_lo: 0.0, follow: false }, [
        Some(30.979281656666043), // f_max
        Some(0.0010131991279868774), // tau
        Some(0.0006041266880195249), // a_1
        Some(0.002863937660630741), // a_2
        Some(0.47650070010060985), // pr
        Some(2.8419034052462727e-05), // p_f
        Some(0.0024423492568450052), // e_f
        Some(622.2334280615894), // centroid
    ]),
    (Case { name: "f_c follows tau", seed: 8, rate: 40960.0, count: 8192, p: 400, is_i16: true, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 0.0001, force_unit: 0.01, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: true }, [
        Some(31.020489130434783), // f_max
        Some(0.0010136504533010083), // tau
        Some(0.0006045878847147871), // a_1
        Some(0.002867503816627445), // a_2
        Some(0.5143520686712131), // pr
        Some(2.8392103820720367e-05), // p_f
        Some(0.002495090838899306), // e_f
        Some(655.304419593322), // centroid
    ]),
    (Case { name: "no baseline", seed: 9, rate: 40960.0, count: 4096, p: 0, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 1.5, noise: 0.002, f_lo: 70.0, follow: false }, [
        None, // f_max
        None, // tau
        None, // a_1
        None, // a_2
        Some(0.5028695737420151), // pr
        Some(5.68722779923892e-05), // p_f
        Some(0.004888300046807618), // e_f
        Some(654.2366534141474), // centroid
    ]),
    (Case { name: "three in four of an odd p", seed: 10, rate: 40960.0, count: 4001, p: 7, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 9.3, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.01, f_lo: 70.0, follow: false }, [
        Some(31.06572104509613), // f_max
        Some(0.0010167607614148502), // tau
        Some(0.0006077009231496349), // a_1
        Some(0.0029004745244470345), // a_2
        Some(0.5025074749682031), // pr
        Some(5.844066717942933e-05), // p_f
        Some(0.005000568821849226), // e_f
        Some(654.7158002020832), // centroid
    ]),
    (Case { name: "late microphone", seed: 11, rate: 40960.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 40.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        Some(30.99192458865693), // f_max
        Some(0.001013338036735083), // tau
        None, // a_1
        None, // a_2
        Some(0.4960963796110181), // pr
        Some(7.307808795078612e-11), // p_f
        Some(2.4701468649123065e-08), // e_f
        Some(1472.4807261153428), // centroid
    ]),
];
