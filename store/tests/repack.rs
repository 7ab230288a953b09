//! An archive packed differently is the same archive.

use std::fs;

use tapline_store::{Codec, Error, Lineage, ReadBuffer, Reader, Writer, repack, verify};
use tapline_wire::{Quality, SampleFormat};

use crate::common::{CONFIG, bytes, discriminators, finished, header, judgement, new_path, plan, put_all, samples};
use crate::places::chunk_bytes;

/// Everything but the samples.
fn tables(reader: &Reader) -> String {
    let texts = (reader.config(), reader.reference(), reader.made_by(), reader.written_by());
    let results = (reader.discriminators().unwrap(), reader.judgements().unwrap(), reader.refusals().unwrap());
    let retaken: Vec<_> = (0..10).map(|row| reader.retaken(row)).collect();
    format!("{texts:?} {results:?} {retaken:?} {:?} {:?} {:?}", reader.plan(), reader.truth(), reader.ledger())
}

/// Catches samples, results or checksums that change on the way, a codec that is not used, and a lineage that depends on it.
#[test]
fn every_codec_gives_the_same_archive() {
    let _guard = crate::common::beside_others();
    for format in [SampleFormat::I16, SampleFormat::F32] {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let plan = plan(format);
        let lineage = Lineage { reference: Some("{}"), made_by: "tests", ..CONFIG.into() };
        let mut writer = Writer::create(path("run.h5"), &plan, plan.taps().len(), lineage).unwrap();
        // One tap was unusable once, one is refused, and one record is shorter than the others.
        writer.put_retake(2, &plan.taps()[2].id, Quality::CLIPPED).unwrap();
        writer.put_refusal(9, &plan.taps()[9].id, "double bounce").unwrap();
        let (mut verdict, cells) = judgement(&plan, 1);
        (verdict.received_count, verdict.refused_count) = (4, 1);
        writer.put_judgement(1, &verdict, &cells).unwrap();
        let short = header(&plan, 4, 20);
        writer.put_tap(&short, &samples(&short)).unwrap();
        writer.put_discriminators(&discriminators(&plan, 4)).unwrap();
        put_all(&mut writer).unwrap();
        writer.finish().unwrap();
        let contents = |reader: &Reader| -> Vec<_> {
            (0..10).map(|row| reader.tap(row).unwrap().map(|(h, s)| (h, bytes(s.as_samples())))).collect()
        };
        let first = Reader::open(path("run.h5")).unwrap();
        // From each to the next, so that every one is read too.
        let mut from = path("run.h5");
        for codec in [Codec::Gzip, Codec::None, Codec::Zstd, Codec::Lz4] {
            let to = path(&format!("{codec}.h5"));
            repack(&from, &to, codec, |_part| ()).unwrap();
            let reader = Reader::open(&to).unwrap();
            assert_eq!((reader.codec(), reader.lineage_key().unwrap()), (codec, first.lineage_key().unwrap()));
            assert!(contents(&reader) == contents(&first), "{codec}");
            for (row, tap) in contents(&reader).into_iter().enumerate() {
                let (mut room, taps, row) = (ReadBuffer::default(), reader.taps().unwrap(), row as u32);
                let beginning = taps.read_beginning(row, |_| 7, &mut room).unwrap();
                let Some((header, whole)) = tap else {
                    assert!(beginning.is_none());
                    continue;
                };
                let (short, samples) = beginning.unwrap();
                let stride = whole.len() / header.channel_count as usize;
                let used = stride / header.sample_count as usize * 7;
                let expected: Vec<u8> = whole.chunks(stride).flat_map(|channel| &channel[..used]).copied().collect();
                assert_eq!((short.sample_count, bytes(samples)), (7, expected), "{codec}");
                let (all, samples) = taps.read_beginning(row, |_| u32::MAX, &mut room).unwrap().unwrap();
                assert_eq!((all, bytes(samples)), (header, whole), "{codec}");
            }
            assert_eq!(tables(&reader), tables(&first));
            assert!(verify(&to).unwrap().is_complete(), "{codec}: {:?}", verify(&to).unwrap().problems);
            drop(reader);
            let resumed = Writer::resume(&to, lineage);
            assert!(matches!(resumed, Err(Error::Finished { .. })), "{codec}");
            drop(resumed);
            from = to;
        }
        // Only the codec decides on the bytes, not the way to them.
        let bytes = |name: &str| fs::read(path(name)).unwrap();
        repack(path("run.h5"), path("again.h5"), Codec::Lz4, |_part| ()).unwrap();
        assert!(bytes("again.h5") == bytes("lz4.h5"));
        assert!(matches!(repack(&from, path("none.h5"), Codec::None, |_part| ()), Err(Error::Exists { .. })));
    }
}

/// Catches a copy of damaged samples that looks whole, and a draft left behind.
#[test]
fn damage_is_not_copied() {
    let (_here, path) = new_path();
    finished(&path, &plan(SampleFormat::I16), Lineage { codec: Codec::None, ..CONFIG.into() });
    let at = chunk_bytes(&hdf5::File::open(&path).unwrap())[3].start;
    let mut bytes = fs::read(&path).unwrap();
    bytes[at + 9] ^= 1;
    fs::write(&path, bytes).unwrap();
    let error = repack(&path, path.with_file_name("to.h5"), Codec::Zstd, |_part| ()).unwrap_err();
    assert!(error.to_string().contains("plan row 3"), "{error}");
    assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
}
