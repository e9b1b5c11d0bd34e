//! Two honest processors keep every promise while a third one writes any words, also behind caches that are not
//! coherent.
#![cfg_attr(fuzzing, no_main)]

use condor_mbox::hostile::{mailbox, mailbox_behind_caches};

condor_fuzz::target!(|bytes| {
    condor_fuzz::report("hostile_mailbox", mailbox(bytes));
    mailbox_behind_caches(bytes);
});
