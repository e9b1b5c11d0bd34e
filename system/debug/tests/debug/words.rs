//! Any words in the area, and any bytes of a debugger, as the fuzz targets have them.
#![cfg(all(feature = "hostile", target_os = "linux"))]

use condor_debug::hostile;
use proptest::prelude::*;

proptest! {
    #[test]
    fn a_stub_bears_any_words(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        hostile::stub(&bytes);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn a_gateway_bears_any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        hostile::gateway(&bytes);
    }

    #[test]
    fn a_gateway_bears_packets_that_look_right(
        packets in prop::collection::vec("(m|M|Z0,|Z2,|z0,|z2,|G|g|P|p|vCont;c|vCont;s|vCont;t|vCtrlC|vStopped|QNonStop:|[?]|qXfer:threads:read::|qRcmd,|D|k|Hg|qSupported:|X)[0-9a-f,:;]{0,20}", 0..8)
    ) {
        let bytes = format!("\u{1}{}", packets.join("\0"));
        hostile::gateway(bytes.as_bytes());
    }
}
