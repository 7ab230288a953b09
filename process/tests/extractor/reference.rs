//! Cases with the values of numpy and scipy; written by `scipy_reference.py`.
//! The values of a case are in the order of `Discriminator::ALL`.

use tapline_wire::Discriminator;

use crate::signal::Case;

#[rustfmt::skip]
pub(crate) const CASES: &[(Case, [Option<f64>; Discriminator::COUNT])] = &[
    (Case { name: "f32 as the rig records it", seed: 1, rate: 40960.0, count: 16384, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        Some(30.976362171822498), Some(0.0010136580384836477), Some(0.0006041437013972598), Some(0.00296505434694269), Some(0.5037256790118779), Some(1.4217084042799288e-05), Some(0.001220325205494844), Some(656.117801523833)]),
    (Case { name: "i16 as the rig records it", seed: 2, rate: 41000.0, count: 16384, p: 400, is_i16: true, has_force: true, sound_first: false, distance: 0.3, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 0.000152587890625, force_unit: 0.00677490234375, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        Some(31.02956911412681), Some(0.0010131833272881482), Some(0.0006041204354730236), Some(0.0029638758783473163), Some(0.5037403715546969), Some(1.4239298437094417e-05), Some(0.0012213440873332692), Some(656.4303966434048)]),
    (Case { name: "i16, odd count, fast", seed: 3, rate: 625000.0, count: 3127, p: 500, is_i16: true, has_force: true, sound_first: false, distance: 0.0, onset: 501.8, tau: 0.0003, f_max: 31.0, sound_unit: 0.001, force_unit: 0.01, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        Some(31.010250000000003), Some(0.00027597335855058614), Some(0.00027863381857680804), Some(0.000994924152127377), Some(0.789560352019488), Some(0.00026218149496005217), Some(0.09683072448014965), Some(913.6173286892819)]),
    (Case { name: "f32, no force, edge on a bin", seed: 4, rate: 200000.0, count: 2000, p: 500, is_i16: false, has_force: false, sound_first: false, distance: 0.0, onset: 503.2, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        None, None, None, Some(0.0019925880257852624), Some(0.5172854781228342), Some(0.00025982197121248904), Some(0.045148298452100104), Some(662.3465388717729)]),
    (Case { name: "i16, no force, odd count", seed: 5, rate: 40960.0, count: 4095, p: 101, is_i16: true, has_force: false, sound_first: false, distance: 0.0, onset: 150.5, tau: 0.0011, f_max: 31.0, sound_unit: 0.0001, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        None, None, None, Some(0.0034671789550781255), Some(0.5024118781832323), Some(5.687281675979786e-05), Some(0.004883920380071138), Some(654.1476902428005)]),
    (Case { name: "f32 on a large offset, sound first", seed: 6, rate: 40960.0, count: 5008, p: 333, is_i16: false, has_force: true, sound_first: true, distance: 0.0, onset: 350.0, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 40.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        Some(31.024104621172768), Some(0.001012524685079319), Some(0.0006039195903116716), Some(0.0028259942307568226), Some(0.5039653788406097), Some(4.6218077973004325e-05), Some(0.003988840253170159), Some(657.3585797961383)]),
    (Case { name: "band from 0 Hz", seed: 7, rate: 40960.0, count: 8192, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.3, noise: 0.002, f_lo: 0.0, follow: false }, [
        Some(30.979281656666043), Some(0.0010131991279868774), Some(0.0006041266880195249), Some(0.002863937660630741), Some(0.47650070010060985), Some(2.8419034052462727e-05), Some(0.0024423492568450052), Some(622.2334280615894)]),
    (Case { name: "f_c follows tau", seed: 8, rate: 40960.0, count: 8192, p: 400, is_i16: true, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 0.0001, force_unit: 0.01, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: true }, [
        Some(31.020489130434783), Some(0.0010136504533010083), Some(0.0006045878847147871), Some(0.002867503816627445), Some(0.5143520686712131), Some(2.8392103820720367e-05), Some(0.002495090838899306), Some(655.304419593322)]),
    (Case { name: "no baseline", seed: 9, rate: 40960.0, count: 4096, p: 0, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 1.5, noise: 0.002, f_lo: 70.0, follow: false }, [
        None, None, None, None, Some(0.5028695737420151), Some(5.68722779923892e-05), Some(0.004888300046807618), Some(654.2366534141474)]),
    (Case { name: "three in four of an odd p", seed: 10, rate: 40960.0, count: 4001, p: 7, is_i16: false, has_force: true, sound_first: false, distance: 0.0, onset: 9.3, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.01, f_lo: 70.0, follow: false }, [
        Some(31.06572104509613), Some(0.0010167607614148502), Some(0.0006077009231496349), Some(0.0029004745244470345), Some(0.5025074749682031), Some(5.844066717942933e-05), Some(0.005000568821849226), Some(654.7158002020832)]),
    (Case { name: "late microphone", seed: 11, rate: 40960.0, count: 4096, p: 400, is_i16: false, has_force: true, sound_first: false, distance: 40.0, onset: 401.37, tau: 0.0011, f_max: 31.0, sound_unit: 1.0, force_unit: 1.0, offset: 0.0, noise: 0.002, f_lo: 70.0, follow: false }, [
        Some(30.99192458865693), Some(0.001013338036735083), None, None, Some(0.4960963796110181), Some(7.307808795078612e-11), Some(2.4701468649123065e-08), Some(1472.4807261153428)]),
];
